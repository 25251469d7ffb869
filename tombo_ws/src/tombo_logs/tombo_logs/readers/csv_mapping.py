"""Mapping files: YAML that says what the columns of a table are, with units and axes.

Those of thrust stands share `ChannelMap` and what reads it; a flight's is a `LogMapping`.
`docs/logs.md` explains it by example; those shipped are in `mappings/`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import ALL_CHANNELS
from tombo_bag.flight import Airframe, Series
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.yaml_file import check_keys, list_of, mapping_of
from tombo_logs.readers.frames import BODIES, WORLDS, axes_matrix, turn_attitude
from tombo_logs.readers.units import factor

M = TypeVar("M")
Parse = Callable[[str, str], M]
"""(text, name) to the mapping that is checked."""
_FARTHEST = 1e9
"""Largest size of a number in a mapping."""
_LARGEST = 200_000
"""Bytes; a mapping is some hundred."""
ORDERS = {"xyzw": 4, "wxyz": 4, "rpy": 3, "ypr": 3, "matrix": 9}
"""How an attitude is written, and in how many columns.

Quaternion; roll, pitch and yaw; rotation matrix, column by column.
"""
_SMALLEST = 1e-9
"""Least value of an airframe, which is above 0."""
ATTITUDES = ("attitude", "estimated_attitude", "attitude_setpoint")
"""Channels that are one."""


@dataclass(frozen=True)
class TimeColumn:
    """A column of times, or the rate at which rows were written."""

    column: str
    unit: str = "s"
    rate: float = 0.0
    """[Hz] of rows without a column of times, which is then empty."""


@dataclass(frozen=True)
class ChannelMap:
    """Where a channel comes from."""

    columns: tuple[str, ...]
    """Names as in the file; a minus before a name changes the sign."""
    unit: str
    order: str = "xyzw"
    """Order of an attitude: one of ORDERS."""
    range: tuple[float, float] | None = None
    """Values of a motor command that mean 0 and 1."""
    axes: tuple[str, ...] | None = None
    """Of gyro and accel where they have axes of their own: ours in terms of the file's."""
    time: TimeColumn | None = None
    """Where the channel has stamps of its own."""
    arrival: TimeColumn | None = None
    topic: str = ""
    """Of recordings and PX4 logs: where the columns are, as `esc[0].rpm` or `data[2]`."""
    scale: float = 1.0
    """Factor of the values, in addition to the unit: -1, 10 for joints that Gazebo slows, 2/14
    where a motor of 14 poles counts electrical turns."""

    def factor(self, wanted: str, what: str) -> float:
        """Return by what to multiply its values to have them in `wanted`, a key of `units.UNITS`.

        Raises:
            InputError: its unit is none for `what`.
        """
        return self.scale * factor(self.unit, wanted, what)


@dataclass(frozen=True)
class LogMapping:
    """A mapping file, checked."""

    name: str
    about: str = ""
    time: TimeColumn | None = None
    world: tuple[str, ...] = WORLDS["ENU"]
    body: tuple[str, ...] = BODIES["FLU"]
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw from base_link to the body that the motion capture has."""
    channels: Mapping[str, ChannelMap] = field(default_factory=dict)
    airframe: Airframe | None = None

    @property
    def by_topic(self) -> dict[str, dict[str, ChannelMap]]:
        """Topic → its channels, for channels with a topic."""
        topics: dict[str, dict[str, ChannelMap]] = {}
        for key, channel in self.channels.items():
            if channel.topic:
                topics.setdefault(channel.topic, {})[key] = channel
        return topics

    @property
    def turn(self) -> Rotation:
        """`turn_deg` as a rotation."""
        return Rotation.from_euler("xyz", self.turn_deg, degrees=True)

    def turn_attitude(self, attitude: Series) -> Series:
        """Return attitudes of base_link, given those of the motion capture's body."""
        same = np.eye(3)
        values = turn_attitude(attitude.values, same, same, self.turn)
        return Series(attitude.t, unwrap_quaternions(values), attitude.arrival)


def shipped() -> dict[str, LogMapping]:
    """Return the mappings that come with the package, by name."""
    return shipped_mappings("tombo_logs", "readers/mappings", parse_mapping)


def shipped_text(name: str) -> str:
    """Return the text of a mapping that comes with the package."""
    file = resources.files("tombo_logs").joinpath(f"readers/mappings/{name}.yaml")
    return file.read_text(encoding="utf-8")


def load_mapping(name: str | Path) -> LogMapping:
    """Read a mapping: the name of a shipped one, or a YAML file.

    Raises:
        InputError: no such mapping, or one that can't be used.
    """
    return read_mapping(str(name), shipped(), parse_mapping)


def parse_mapping(text: str, name: str) -> LogMapping:
    """Check the text of a mapping file.

    Raises:
        InputError: not a mapping; names the key, and the accepted values.
    """
    what = f"mapping '{name}'"
    values = table_of(parse_yaml(text, what), what, [f.name for f in fields(LogMapping)])
    world = _axes(values.get("world", "ENU"), WORLDS, f"{what}: world")
    body = _axes(values.get("body", "FLU"), BODIES, f"{what}: body")
    for axes in (world, body):
        if np.linalg.det(axes_matrix(axes, what)) < 0.0:
            raise InputError(
                f"{what}: axes {list(axes)} are mirrored; accepted: right-handed ones"
            )
    channels = table_of(values.get("channels"), f"{what}: channels", ALL_CHANNELS)
    return LogMapping(
        name=str(values.get("name", Path(name).stem)),
        about=str(values.get("about", "")),
        time=_time(values.get("time"), f"{what}: time"),
        world=world,
        body=body,
        turn_deg=numbers_of(values.get("turn_deg", [0.0, 0.0, 0.0]), 3, f"{what}: turn_deg"),
        channels={key: _channel(key, value, what) for key, value in channels.items()},
        airframe=_airframe(values.get("airframe"), f"{what}: airframe"),
    )


def _channel(key: str, content: object, what: str) -> ChannelMap:
    what = f"{what}: {key}"
    values = table_of(content, what, [f.name for f in fields(ChannelMap)])
    channel = ALL_CHANNELS[key]
    order, turns = str(values.get("order", "xyzw")), key in ATTITUDES
    if order not in ORDERS:
        raise unknown_name(f"order of {what}", order, ORDERS)
    width = ORDERS[order] if turns else channel.width
    columns = columns_of(values.get("columns", ()), what, width, f"{width} names of columns")
    wanted = "rad" if turns and width == 3 else channel.unit
    unit, span = str(values.get("unit", "1")), values.get("range")
    if span is not None:
        low, high = numbers_of(span, 2, f"{what}: range")
        if not high > low or key != "motor_command":
            raise InputError(
                f"{what}: range {shown(span)}; accepted: [low, high], of motor_command"
            )
        span = low, high
    else:
        unit = unit_of(values, wanted, what)
    axes = values.get("axes")
    if axes is not None and key not in ("gyro", "accel"):
        raise InputError(f"{what}: axes; accepted: for gyro and accel, else world and body")
    return ChannelMap(
        columns=columns,
        unit=unit,
        order=order,
        range=span,
        axes=None if axes is None else _axes(axes, BODIES, f"{what}: axes"),
        time=_time(values.get("time"), f"{what}: time"),
        arrival=_time(values.get("arrival"), f"{what}: arrival"),
        topic=str(values.get("topic", "")),
        scale=numbers_of([values.get("scale", 1.0)], 1, f"{what}: scale")[0],
    )


def _time(content: object, what: str) -> TimeColumn | None:
    if content is None:
        return None
    if isinstance(content, str):
        content = {"column": content}
    values = table_of(content, what, ("column", "unit", "rate"))
    if ("column" in values) == ("rate" in values):
        raise InputError(f"{what}: no column, or rate besides; accepted: column, or rate in Hz")
    if "rate" in values:
        return TimeColumn("", rate=check_number(f"{what}: rate", values["rate"], "Hz", (0.1, 1e5)))
    time = TimeColumn(str(values["column"]), str(values.get("unit", "s")))
    factor(time.unit, "s", what)
    return time


def _axes(content: object, names: Mapping[str, tuple[str, ...]], what: str) -> tuple[str, ...]:
    if isinstance(content, str):
        if content.upper() not in names:
            raise unknown_name(what, content, [*names, "[x, y, z] in any order and sign"])
        return names[content.upper()]
    if not isinstance(content, Sequence) or len(content) != 3:
        raise InputError(f"{what}: {shown(content)}; accepted: {', '.join(names)}, or [y, x, -z]")
    axes = tuple(str(axis) for axis in content)
    axes_matrix(axes, what)
    return axes


def _airframe(content: object, what: str) -> Airframe | None:
    if content is None:
        return None
    if isinstance(content, str):
        from tombo_flight.vehicle_file import read_vehicle
        from tombo_logs.readers.vehicle_airframe import airframe_of  # imports compiled code

        return airframe_of(read_vehicle(content))
    names = [f.name for f in fields(Airframe)]
    values: dict[str, Any] = {"name": "airframe", **table_of(content, what, names)}
    lacking = [n for n in names[:4] if n not in values]
    if lacking:
        raise InputError(f"{what}: no {', '.join(lacking)}; accepted: {', '.join(names)}")
    for name, value in values.items():
        if name == "inertia":
            values[name] = numbers_of(value, 3, f"{what}: {name}")
        elif name != "name":
            values[name] = check_number(f"{what}: {name}", value, "SI", (_SMALLEST, 1e9))
    return Airframe(**values)


def shipped_mappings(package: str, folder: str, parse: Parse[M]) -> dict[str, M]:
    """Return the mappings in a folder of a package, by name."""
    files = resources.files(package).joinpath(folder).iterdir()
    names = {f.name.removesuffix(".yaml"): f for f in files if f.name.endswith(".yaml")}
    return {n: parse(f.read_text(encoding="utf-8"), n) for n, f in sorted(names.items())}


def read_mapping(name: str, known: Mapping[str, M], parse: Parse[M]) -> M:
    """Return a mapping: one of `known` by its name, or that of a YAML file.

    Raises:
        InputError: no such mapping, or one that can't be used.
    """
    path = Path(name)
    accepted = f"accepted: a YAML file, or {', '.join(known)}"
    if path.is_dir():
        raise InputError(f"mapping '{name}' is a folder; {accepted}")
    if not path.is_file():
        if name in known:
            return known[name]
        if path.suffix in (".yaml", ".yml") or path.parent != Path():
            raise InputError(f"mapping '{name}' does not exist; {accepted}")
        raise unknown_name("mapping", name, [*known, "a YAML file"])
    return parse(read_text(path, f"mapping '{name}'", "a short YAML file", _LARGEST), name)


def table_of(content: object, what: str, accepted: Collection[str]) -> dict[str, Any]:
    """Return a table of a mapping file; of none, an empty one.

    Raises:
        InputError: it is not a table, or has a key that is not accepted.
    """
    values = mapping_of({} if content is None else content, what)
    check_keys(values, accepted, what)
    return dict(values)


def columns_of(content: object, what: str, width: int | None, names: str) -> tuple[str, ...]:
    """Return the names of a channel's columns: `width` of them, or of None any number.

    Raises:
        InputError: others; `names` says what is accepted.
    """
    columns = (content,) if isinstance(content, str) else content
    if isinstance(columns, Sequence) and columns and width in (None, len(columns)):
        return tuple(str(column) for column in columns)
    raise InputError(f"{what}: columns {shown(content)}; accepted: {names}")


def unit_of(values: Mapping[str, Any], wanted: str, what: str) -> str:
    """Return the unit that a channel declares in the place of `wanted`, a key of `units.UNITS`.

    Raises:
        InputError: there is none, and `wanted` is not 1; or it is none of those accepted.
    """
    if "unit" not in values and wanted != "1":
        raise InputError(f"{what}: no unit; accepted: a unit as {wanted}")
    unit = str(values.get("unit", "1"))
    factor(unit, wanted, what)
    return unit


def numbers_of(content: object, count: int, what: str) -> tuple[Any, ...]:
    """Return finite numbers, `count` of them.

    Raises:
        InputError: others.
    """
    values = list_of(content, what)
    if len(values) != count:
        raise InputError(f"{what}: {shown(content)}; accepted: {count} numbers")
    return tuple(check_number(what, value, "1", (-_FARTHEST, _FARTHEST)) for value in values)
