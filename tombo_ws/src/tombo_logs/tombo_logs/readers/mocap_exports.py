"""Exports of motion-capture software, as a table with one header and the text of its mapping.

- Motive (OptiTrack), CSV: five rows of header; rotations as quaternions, y up by default.
- QTM (Qualisys), TSV of 6D data: millimetres, z up; the rotation matrix column by column.
- TUM trajectories: `timestamp tx ty tz qx qy qz qw` without a header.
"""

from __future__ import annotations

import io
import json
import math
from typing import Final

from tombo_dynamics.errors import InputError

_MOTIVE: Final = b"Format Version,"
_QTM: Final = b"NO_OF_FRAMES\t"
_VICON: Final = (b"Objects\r", b"Objects\n")
"""How a file of each begins."""
_Y_UP: Final = ["x", "-z", "y"]
_Z_UP: Final = ["x", "y", "z"]
_LENGTHS: Final = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
_TUM: Final = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
_ACCEPTED: Final = "accepted: exports of Motive (CSV), of QTM (TSV, 6D), TUM trajectories"


def as_table(text: bytes) -> tuple[bytes, str] | None:
    """Return an export as a table and the text of its mapping; None if it is another table.

    The mapping is empty where several rigid bodies could be the vehicle.

    Raises:
        InputError: an export without poses as they are needed; says how to export it.
    """
    if text.startswith(_MOTIVE):
        return _motive(text)
    if text.startswith(_QTM):
        return _qtm(text)
    if text.startswith(_VICON):
        raise InputError(f"a table of Vicon Tracker, which has no column of times; {_ACCEPTED}")
    # lazily: most tables are none of these, and may be large
    first = next((line for line in io.BytesIO(text) if line.strip() and line[:1] != b"#"), b"")
    if _is_tum(first.split()):
        rows = [b",".join(line.split()) for line in text.splitlines() if line[:1] != b"#"]
        mapping = _mapping("tum", "time", _Z_UP, "m", list(_TUM[1:4]), list(_TUM[4:]), "xyzw")
        return b"\n".join([",".join(_TUM).encode(), *rows, b""]), mapping
    return None


def _motive(text: bytes) -> tuple[bytes, str]:
    lines = text.splitlines()
    cells = [line.decode("utf-8", "replace").split(",") for line in lines[:12]]
    settings = dict(zip(cells[0][::2], cells[0][1::2], strict=False))
    at = next((i for i, row in enumerate(cells) if row[:2] == ["Frame", "Time (Seconds)"]), 0)
    if at < 4:
        raise InputError(f"an export of Motive without its header; {_ACCEPTED}")
    width = len(cells[at])
    above = [row + [""] * (width - len(row)) for row in cells[1:at]]
    kinds = next((row for row in above if "Type" in row[:2]), [""] * width)
    names = next((row for row in above if "Name" in row[:2]), [""] * width)
    columns = ["frame", "time"] + [
        ".".join(filter(None, (names[i], above[-1][i], cells[at][i]))) for i in range(2, width)
    ]
    bodies = {name for kind, name in zip(kinds, names, strict=True) if kind == "Rigid Body"}
    table = b"\n".join([",".join(columns).encode(), *lines[at + 1 :], b""])
    if len(bodies) != 1:
        return table, ""
    (body,) = bodies
    attitude = [f"{body}.Rotation.{axis}" for axis in "XYZW"]
    if not set(attitude) <= set(columns):
        raise InputError(
            f"rotations of '{body}' of type {settings.get('Rotation Type')}; accepted: an export "
            "of Motive with Rotation Type Quaternion"
        )
    unit = _LENGTHS.get(settings.get("Length Units", "Meters").lower(), "m")
    position = [f"{body}.Position.{axis}" for axis in "XYZ"]
    return table, _mapping("motive", "time", _Y_UP, unit, position, attitude, "xyzw")


def _qtm(text: bytes) -> tuple[bytes, str]:
    lines = text.splitlines()
    names: list[str] = []
    rate = ""
    while lines:
        cells = lines.pop(0).decode("utf-8", "replace").split("\t")
        if cells[0] == "BODY_NAMES":
            names = [value for value in cells[1:] if value]
        if cells[0] == "FREQUENCY":
            rate = "".join(cells[1:2])
        if names and cells[0] in ("Frame", "Time", "X", f"{names[0]} X"):
            break
    else:
        raise InputError(f"an export of QTM without rigid bodies (6D); {_ACCEPTED}")
    columns: list[str] = []
    body = names[0]
    for value in cells:
        body = next((name for name in names if value == f"{name} X"), body)
        axis = value.removeprefix(f"{body} ")
        columns.append(value if value in ("Frame", "Time") else f"{body}.{axis}")
    table = b"\n".join(["\t".join(columns).encode(), *lines, b""])
    if len(names) != 1:
        return table, ""
    position = [f"{body}.{axis}" for axis in "XYZ"]
    attitude = [f"{body}.Rot[{k}]" for k in range(9)]
    try:
        time = "Time" if "Time" in columns else {"rate": float(rate)}
    except ValueError as error:
        raise InputError(
            f"an export of QTM without times, and its FREQUENCY is '{rate}'; accepted: a number"
        ) from error
    return table, _mapping("qtm", time, _Z_UP, "mm", position, attitude, "matrix")


def _mapping(
    name: str, time: str | dict[str, float], axes: list[str], unit: str, position: list[str],
    attitude: list[str], order: str,
) -> str:  # fmt: skip
    """Return the text of a mapping; JSON is YAML."""
    channels = {
        "position": {"columns": position, "unit": unit},
        "attitude": {"columns": attitude, "order": order},
    }
    fields = {"name": name, "time": time, "world": axes, "body": axes, "channels": channels}
    return json.dumps(fields, indent=1)


def _is_tum(cells: list[bytes]) -> bool:
    """Return whether a row is eight numbers, the last four a quaternion."""
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        return False
    return len(numbers) == len(_TUM) and abs(math.hypot(*numbers[4:]) - 1.0) < 0.01
