"""Mapping files: YAML that says what the columns of a table are, of flights and thrust stands."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.yaml_text import read_text
from tombo_flight.yaml_file import check_keys, list_of, mapping_of
from tombo_logs.readers.units import factor

M = TypeVar("M")
Parse = Callable[[str, str], M]
"""(text, name) to the mapping that is checked."""
_FARTHEST = 1e9
"""Of any number in a mapping."""
_LARGEST = 200_000
"""Bytes; a mapping is some hundred."""


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
    """As in the file; with a minus before it, of the opposite sign."""
    unit: str
    order: str = "xyzw"
    """Of an attitude: one of ORDERS."""
    range: tuple[float, float] | None = None
    """Of a motor command: values of 0 and of 1."""
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
