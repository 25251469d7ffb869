"""The library of materials, blades, configurations and measurements, read from data files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.propeller.records import (
    Blade,
    BladeSection,
    BladeSegment,
    CollisionPosition,
    Configuration,
    Fibre,
    Joint,
    Matrix,
    Measurement,
    Nodus,
    PublishedTorsion,
)
from tombo_dynamics.yaml_text import read_yaml

_Record = TypeVar("_Record")


def record(cls: type[_Record], values: object, where: str, **known: Any) -> _Record:
    """Build the record `cls` from a mapping; `known` holds fields that are already read.

    Raises:
        InputError: names a key that is unknown or missing, or a number that is out of bounds.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{where}: {shown(values)}; accepted: a mapping of keys to values")
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    accepted = [name for name, f in fields.items() if f.metadata]
    for key in values:
        if key not in accepted:
            raise unknown_name(f"key in {where}", key, accepted)
    built = dict(known)
    for name in accepted:
        optional = fields[name].default is not dataclasses.MISSING
        if values.get(name) is None and optional:
            continue
        if name not in values:
            unit = fields[name].metadata["unit"]
            raise InputError(f"{where}: no {name} [{unit}]; accepted: one is needed")
        built[name] = _field(fields[name], values[name], f"{where}.{name}")
    return cls(**built)


def _field(field: Any, value: object, where: str) -> float | int | tuple[float, ...]:
    unit, bounds = field.metadata["unit"], field.metadata["bounds"]
    if field.type.startswith("tuple"):
        if not isinstance(value, list):
            raise InputError(f"{where}: {shown(value)}; accepted: a list of numbers [{unit}]")
        return tuple(check_number(f"{where}[{i}]", v, unit, bounds) for i, v in enumerate(value))
    if field.type == "int":
        return int(check_number(where, value, unit, bounds, integer=True))
    return check_number(where, value, unit, bounds)


DATA = Path(__file__).parent / "data"
FILES = ("materials.yaml", "blades.yaml", "configurations.yaml", "measurements.yaml")
_NODUS_KEYS = ("fibres", "fibre_diameter_mm", "length_mm")
_PRINTED_KEYS = ("printed_E_N_MPa", "printed_G_N_MPa")
_OTHER_KEYS = ("conf", "name", "blade", "matrix", "fibre", "edge")


@dataclass(frozen=True)
class Library:
    """Everything that the data files hold, by name or number."""

    matrices: Mapping[str, Matrix]
    fibres: Mapping[str, Fibre]
    blades: Mapping[str, Blade]
    configurations: Mapping[int, Configuration]
    collision_positions: tuple[CollisionPosition, ...]

    def configuration(self, number: Any) -> Configuration:
        """Return a configuration by its number.

        Raises:
            InputError: there is no such configuration.
        """
        known = self.configurations
        whole = isinstance(number, int | float | np.integer) and not isinstance(number, bool)
        if not whole or number not in known:
            raise InputError(
                f"unknown configuration {shown(number)}; accepted: {', '.join(map(str, known))}"
            )
        return known[number]


def read_library(*folders: Path | str) -> Library:
    """Read the built-in data and then each folder's; a name read later replaces the earlier one.

    Args:
        folders: folders with any of materials.yaml, blades.yaml, configurations.yaml,
            measurements.yaml, in the form of the built-in ones. They are read again every time.

    Raises:
        InputError: a folder has none of these files, a file is not readable, or a key, a name or a
            number in it does not fit.
    """
    for folder in folders:
        if not isinstance(folder, str | Path):
            raise InputError(f"folder {shown(folder)}; accepted: a path")
    return _read(tuple(Path(folder) for folder in folders)) if folders else _built_in()


@lru_cache(maxsize=1)
def _built_in() -> Library:
    return _read(())


def _read(folders: tuple[Path, ...]) -> Library:
    matrices: dict[str, Matrix] = {}
    fibres: dict[str, Fibre] = {}
    blades: dict[str, Blade] = {}
    rows: dict[int, Mapping[str, Any]] = {}
    measured: dict[int, Measurement] = {}
    positions: tuple[CollisionPosition, ...] = ()
    for folder in (DATA, *folders):
        if not any((folder / name).is_file() for name in FILES):
            raise InputError(
                f"{folder}: {'holds' if folder.is_dir() else 'no such folder, so'} no data files; "
                f"accepted: a folder with any of {', '.join(FILES)}"
            )
        materials = _mapping(folder / "materials.yaml", ("matrices", "fibres"))
        for name, values in _items(materials, "matrices"):
            matrices[name] = record(Matrix, values, f"matrices.{name}", name=name)
        for name, values in _items(materials, "fibres"):
            fibres[name] = record(Fibre, values, f"fibres.{name}", name=name)
        for name, values in _mapping(folder / "blades.yaml", None).items():
            blades[name] = _blade(name, values)
        read: dict[int, Mapping[str, Any]] = {}
        for values in _rows(folder / "configurations.yaml"):
            number = _number(values, "configurations")
            if number in read:
                raise InputError(
                    f"{folder / 'configurations.yaml'}: conf {number} twice; accepted: once"
                )
            read[number] = values
        rows |= read
        tables = _mapping(folder / "measurements.yaml", ("at_2000_rpm", "collision_positions"))
        for values in _list(tables, "at_2000_rpm"):
            number = _number(values, "at_2000_rpm")
            figures = {key: value for key, value in values.items() if key != "conf"}
            measured[number] = record(Measurement, figures, f"at_2000_rpm, conf {number}")
        if "collision_positions" in tables:
            positions = tuple(
                record(CollisionPosition, values, f"collision_positions[{i}]")
                for i, values in enumerate(_list(tables, "collision_positions"))
            )
    configurations = {
        number: _configuration(number, rows[number], matrices, fibres, blades, measured)
        for number in sorted(rows)
    }
    return Library(matrices, fibres, blades, configurations, positions)


def configuration(number: int) -> Configuration:
    """Return a configuration of the paper's Table I; 0 is the rigid propeller.

    Raises:
        InputError: there is no such configuration.
    """
    return read_library().configuration(number)


def known_configuration(choice: Any) -> Configuration:
    """Return a configuration as it is, or the one of the paper's Table I that a number means.

    Raises:
        InputError: neither, or there is no such configuration.
    """
    if isinstance(choice, Configuration):
        return choice
    return read_library().configuration(choice)


def configurations() -> tuple[Configuration, ...]:
    """Return all configurations of the paper's Table I, by number."""
    return tuple(read_library().configurations.values())


def _mapping(path: Path, accepted: tuple[str, ...] | None) -> Mapping[str, Any]:
    if not path.is_file():
        return {}
    values = read_yaml(path, str(path))
    if not isinstance(values, Mapping):
        raise InputError(f"{path}: holds no mapping; accepted: names with their values")
    for key in values:
        if accepted is not None and key not in accepted:
            raise unknown_name(f"key in {path}", key, accepted)
    return values


def _items(values: Mapping[str, Any], key: str) -> list[tuple[str, Any]]:
    items = values.get(key, {})
    if not isinstance(items, Mapping) or not all(isinstance(name, str) for name in items):
        raise InputError(f"{key}: {shown(items)}; accepted: names with their values")
    return list(items.items())


def _list(values: Mapping[str, Any], key: str) -> list[Any]:
    items = values.get(key, [])
    if not isinstance(items, list):
        raise InputError(f"{key}: {shown(items)}; accepted: a list")
    return items


def _rows(path: Path) -> list[Mapping[str, Any]]:
    if not path.is_file():
        return []
    rows = read_yaml(path, str(path))
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise InputError(f"{path}: holds no list; accepted: a list of configurations")
    return rows


def _number(values: Mapping[str, Any], where: str) -> int:
    number = values.get("conf") if isinstance(values, Mapping) else None
    if isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise InputError(f"{where}: conf {shown(number)}; accepted: a whole number from 0")
    return number


def _blade(name: str, values: object) -> Blade:
    where = f"blades.{name}"
    if not isinstance(values, Mapping):
        raise InputError(f"{where}: {shown(values)}; accepted: a mapping of keys to values")
    plain = dict(values)
    pieces = plain.pop("pieces", [])
    if not isinstance(pieces, list):
        raise InputError(f"{where}.pieces: {shown(pieces)}; accepted: a list of pieces")
    published = plain.pop("published", None)
    return record(
        Blade,
        {key: value for key, value in plain.items() if key not in ("section", "joint")},
        where,
        name=name,
        pieces=tuple(
            record(BladeSegment, piece, f"{where}.pieces[{i}]") for i, piece in enumerate(pieces)
        ),
        section=record(BladeSection, plain.get("section"), f"{where}.section"),
        joint=record(Joint, plain.get("joint"), f"{where}.joint"),
        published=None
        if published is None
        else record(PublishedTorsion, published, f"{where}.published"),
    )


def _configuration(
    number: int,
    values: Mapping[str, Any],
    matrices: Mapping[str, Matrix],
    fibres: Mapping[str, Fibre],
    blades: Mapping[str, Blade],
    measured: Mapping[int, Measurement],
) -> Configuration:
    where = f"configuration {number}"
    for key in values:
        if key not in _OTHER_KEYS + _NODUS_KEYS + _PRINTED_KEYS:
            raise unknown_name(f"key in {where}", key, _OTHER_KEYS + _NODUS_KEYS + _PRINTED_KEYS)
    blade = _named(values.get("blade"), blades, "blade", where)
    nodus = None
    if values.get("matrix") is not None:
        nodus = record(
            Nodus,
            {key: values[key] for key in _NODUS_KEYS if key in values},
            where,
            matrix=_named(values["matrix"], matrices, "matrix", where),
            fibre=_named(values.get("fibre"), fibres, "fibre", where),
        )
        start = blade.joint.outer_radius_m - nodus.length_mm * 1e-3
        if start < 0.0:
            raise InputError(
                f"{where}.length_mm: {nodus.length_mm} starts behind the hub's centre; accepted: "
                f"at most {blade.joint.outer_radius_m * 1e3:g} mm"
            )
    edge, name = values.get("edge"), values.get("name", "")
    if not isinstance(name, str):
        raise InputError(f"{where}.name: {shown(name)}; accepted: a text")
    return record(
        Configuration,
        {key: values[key] for key in _PRINTED_KEYS if key in values},
        where,
        number=number,
        blade=blade,
        nodus=nodus,
        edge=None if edge is None else _named(edge, matrices, "edge", where).name,
        measured=measured.get(number),
        name=name,
    )


def _named(name: object, known: Mapping[str, Any], what: str, where: str) -> Any:
    if not isinstance(name, str) or name not in known:
        raise unknown_name(f"{what} in {where}", name, known)
    return known[name]
