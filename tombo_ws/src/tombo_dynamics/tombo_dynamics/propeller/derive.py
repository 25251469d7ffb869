"""New configurations from known ones: another nodus, joint, position, section."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import validate
from tombo_dynamics.propeller.blade import wing_mass_from
from tombo_dynamics.propeller.library import Library, known_configuration, read_library
from tombo_dynamics.propeller.records import Blade, Configuration, Fibre, Matrix, Nodus

_NODUS = ("matrix", "fibre", "fibres", "fibre_diameter_mm", "length_mm")


def with_nodus(
    configuration: Configuration | int,
    *,
    matrix: Matrix | str | None = None,
    fibre: Fibre | str | None = None,
    fibres: int | None = None,
    fibre_diameter_mm: float | None = None,
    length_mm: float | None = None,
    outer_radius_m: float | None = None,
    name: str | None = None,
    library: Library | None = None,
    **unknown: object,
) -> Configuration:
    """Return a configuration with another nodus; what is not given stays.

    What was measured or printed of the original is left behind. A rigid propeller gets a nodus if
    matrix, fibre, fibres, fibre_diameter_mm and length_mm are all given.

    Args:
        configuration: where to begin, or its number in Table I.
        matrix: a record, or the name of one in the library.
        fibre: a record, or the name of one in the library.
        fibres: how many.
        fibre_diameter_mm: of one fibre [mm].
        length_mm: length of the nodus along the span [mm].
        outer_radius_m: where the nodus ends and the wing begins [m]. Mass and centroid of the wing
            follow (`wing_mass.wing_mass_from`); what belongs to the joint's section stays.
        name: what to call it; otherwise the changes.
        library: where names are looked up; otherwise the built-in one.
        **unknown: refused by name.

    Raises:
        InputError: an unknown name, a number out of its bounds, a nodus that does not fit on the
            blade, or a rigid propeller with less than a whole nodus.
    """
    for key in unknown:
        raise unknown_name("value of a nodus", key, (*_NODUS, "outer_radius_m"))
    configuration = known_configuration(configuration)
    known = library or read_library()
    values: dict[str, Any] = {
        "matrix": _looked_up(matrix, known.matrices, "matrix"),
        "fibre": _looked_up(fibre, known.fibres, "fibre"),
        "fibres": fibres,
        "fibre_diameter_mm": fibre_diameter_mm,
        "length_mm": length_mm,
    }
    changes = {key: _plain(value) for key, value in values.items() if value is not None}
    outer_radius_m = _plain(outer_radius_m)
    blade = configuration.blade
    if outer_radius_m is not None:
        blade = _moved(blade, outer_radius_m)
    nodus = configuration.nodus
    if nodus is not None:
        nodus = dataclasses.replace(nodus, **changes)
    elif changes:
        missing = [key for key in _NODUS if key not in changes]
        if missing:
            raise InputError(
                f"{configuration.label} is rigid, a nodus for it needs {', '.join(missing)} as "
                "well; accepted: all five"
            )
        nodus = Nodus(**changes)
    if nodus is not None:
        validate(nodus, "nodus")
    described = {key: getattr(value, "name", value) for key, value in changes.items()}
    described |= {} if outer_radius_m is None else {"outer_radius_m": outer_radius_m}
    return _derived(configuration, blade, nodus, described, name)


def with_joint(
    configuration: Configuration | int, *, name: str | None = None, **changes: float
) -> Configuration:
    """Return a configuration with other values of the blade's joint, by name of `Joint`'s fields.

    They are taken as they are: with `outer_radius_m`, mass and centroid of the wing stay (compare
    `with_nodus`).

    Raises:
        InputError: an unknown name, or a number out of its bounds.
    """
    return _with_part(known_configuration(configuration), "joint", changes, name)


def with_section(
    configuration: Configuration | int, *, name: str | None = None, **changes: float
) -> Configuration:
    """Return a configuration with other force coefficients, by name of `BladeSection`'s fields.

    Raises:
        InputError: an unknown name, or a number out of its bounds.
    """
    return _with_part(known_configuration(configuration), "section", changes, name)


def _with_part(
    origin: Configuration, part: str, changes: dict[str, Any], name: str | None
) -> Configuration:
    """Return a configuration with other values of one of its blade's records."""
    new: dict[str, Any] = {part: _replaced(getattr(origin.blade, part), changes, part)}
    return _derived(origin, dataclasses.replace(origin.blade, **new), origin.nodus, changes, name)


def _moved(blade: Blade, outer_radius_m: float) -> Blade:
    low, high = blade.pieces[0].start_m, blade.pieces[-1].end_m
    if not isinstance(outer_radius_m, int | float) or not low < outer_radius_m < high:
        raise InputError(
            f"outer_radius_m: {shown(outer_radius_m)}; accepted: between {low} and {high} m, "
            "on the blade"
        )
    mass, centroid = wing_mass_from(blade, outer_radius_m)
    changes = {
        "outer_radius_m": outer_radius_m,
        "wing_mass_kg": float(mass),
        "wing_centroid_m": float(centroid),
    }
    return dataclasses.replace(blade, joint=_replaced(blade.joint, changes, "joint"))


def _replaced(record: Any, changes: dict[str, Any], what: str) -> Any:
    accepted = [f.name for f in dataclasses.fields(record)]
    for key in changes:
        if key not in accepted:
            raise unknown_name(f"value of a {what}", key, accepted)
    new = dataclasses.replace(record, **{key: _plain(value) for key, value in changes.items()})
    validate(new, what)
    return new


def _derived(
    origin: Configuration,
    blade: Blade,
    nodus: Nodus | None,
    changes: dict[str, Any],
    name: str | None,
) -> Configuration:
    if nodus is not None and nodus.length_mm * 1e-3 > blade.joint.outer_radius_m:
        raise InputError(
            f"length_mm: {nodus.length_mm} starts behind the hub's centre; accepted: at most "
            f"{blade.joint.outer_radius_m * 1e3:g} mm"
        )
    if not changes and name is None:
        return origin
    words = ", ".join(f"{key} {value}" for key, value in changes.items())
    return dataclasses.replace(
        origin,
        blade=blade,
        nodus=nodus,
        name=name or f"{origin.label}, {words}",
        printed_E_N_MPa=None,
        printed_G_N_MPa=None,
        measured=None,
    )


def _looked_up(value: Any, known: Any, what: str) -> Any:
    if value is None or isinstance(value, Matrix if what == "matrix" else Fibre):
        return value
    if not isinstance(value, str) or value not in known:
        raise unknown_name(what, value, known)
    return known[value]


def _plain(value: Any) -> Any:
    """Return numpy's numbers as Python's."""
    return value.item() if isinstance(value, np.generic) else value
