"""Rows of parameters for many propellers at once: a configuration with named quantities changed.

A row is what a law is given (`laws.parameters`). Changed quantities are arrays; what does not
depend on them is not computed again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.propeller.blade import wing_from, wing_mass_from
from tombo_dynamics.propeller.laws.parameters import (
    DEFAULT_LAW,
    OF_THE_WING,
    ROW_SIZE,
    SCALARS,
    checked,
    parameter_row,
    put_wing,
)
from tombo_dynamics.propeller.library import read_library
from tombo_dynamics.propeller.quantities import (
    COMPLIANCES,
    QUANTITIES,
    derive,
    inputs_of,
    matrix_modulus,
    reached,
)
from tombo_dynamics.propeller.records import STANDARD, Configuration, Fibre, Matrix, Surroundings

MATERIALS = ("matrix", "fibre")
_WING_FOLLOWS = ("wing_mass_kg", "wing_centroid_m")
_RADII_AT_ONCE = 4096


def checked_changes(changes: Mapping[str, Any]) -> dict[str, dict[str, Array]]:
    """Return by changed name its quantities: a material is replaced by its moduli.

    Raises:
        InputError: an unknown name, no number, or one out of its bounds.
    """
    quantities: dict[str, dict[str, Array]] = {}
    for name, value in changes.items():
        if name in MATERIALS:
            quantities[name] = _material(name, value)
        elif name in QUANTITIES:
            quantities[name] = {name: _numbers(name, value)}
        else:
            raise unknown_name("quantity", name, (*QUANTITIES, *MATERIALS))
    for name in MATERIALS:
        for part in quantities.get(name, {}):
            if part in quantities:
                raise InputError(f"{name} and {part}: a {name} has one; accepted: one of them")
    return quantities


def parameter_rows(
    configuration: Configuration | int,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    **changes: Any,
) -> Array:
    """Return rows (..., ROW_SIZE) of a configuration with named quantities changed.

    Args:
        configuration: a Configuration, or a number of Table I.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        **changes: by name of `QUANTITIES`, numbers of any shape; and `matrix` or `fibre`, records
            or names of the built-in ones. All broadcast with each other. Along with
            `outer_radius_m` the wing's mass and centroid change, unless they are given; what
            belongs to the joint's section stays.

    Raises:
        InputError: what is not accepted, or a quantity without effect: hidden by another one,
            unknown to the law, or of a nodus where there is none.
    """
    chosen, law, surroundings = checked(configuration, law, surroundings)
    if not changes:
        return parameter_row(chosen, law, surroundings)
    groups = checked_changes(changes)
    _check_effect(chosen, law, groups)
    values = {name: value for group in groups.values() for name, value in group.items()}
    try:
        shape = np.broadcast_shapes(*(value.shape for value in values.values()))
    except ValueError:
        raise broadcast_error(values) from None
    rows = np.array(np.broadcast_to(parameter_row(chosen, law, surroundings), (*shape, ROW_SIZE)))
    known: dict[str, Any] = dict(inputs_of(chosen, law, surroundings))
    moved = values.get("outer_radius_m")
    if "length_mm" in values or moved is not None:
        _check_length(known | values)
    if moved is not None:
        _move(rows, chosen, np.broadcast_to(moved, shape), known)
    known |= values
    changed = (*values, *(_WING_FOLLOWS if moved is not None else ()))
    for name, sources in reached(law, changed, tuple(SCALARS)).items():
        if sources:
            rows[..., SCALARS[name]] = derive(name, known, law)
    if not np.isfinite(rows).all():
        raise InputError(
            f"{', '.join(values)}: so far from each other that a law's parameter is not finite; "
            "accepted: a propeller"
        )
    return rows


def _move(rows: Array, chosen: Configuration, radius: Array, known: dict[str, Any]) -> None:
    """Let the wing begin at other radii [m]: integrals, mass and centroid."""
    blade = chosen.blade
    radii, back = np.unique(radius, return_inverse=True)
    back = back.reshape(radius.shape)
    low, high = blade.pieces[0].start_m, blade.pieces[-1].end_m
    outside = ~((radii > low) & (radii < high))
    if outside.any():
        raise InputError(
            f"outer_radius_m {radii[outside][0]:g} is outside of blade {blade.name}; "
            f"accepted: between {low} and {high} m"
        )
    moved = np.empty((radii.size, ROW_SIZE))
    mass, centroid = np.empty(radii.size), np.empty(radii.size)
    for start in range(0, radii.size, _RADII_AT_ONCE):
        part = slice(start, start + _RADII_AT_ONCE)
        put_wing(moved[part], wing_from(blade, radii[part]))
        mass[part], centroid[part] = wing_mass_from(blade, radii[part])
    rows[...] = np.where(OF_THE_WING, moved[back], rows)
    known["wing_mass_kg"], known["wing_centroid_m"] = mass[back], centroid[back]


def _check_length(known: Mapping[str, Any]) -> None:
    if "length_mm" not in known:
        return
    length, radius = np.broadcast_arrays(known["length_mm"], known["outer_radius_m"])
    behind = length * 1e-3 > radius
    if behind.any():
        raise InputError(
            f"length_mm {length[behind].flat[0]:g} starts behind the hub's centre; accepted: at "
            f"most {radius[behind].flat[0] * 1e3:g} mm"
        )


def _check_effect(
    chosen: Configuration, law: str, groups: Mapping[str, Mapping[str, Array]]
) -> None:
    names = tuple(part for group in groups.values() for part in group)
    by_number = reached(law, names, tuple(SCALARS))
    effective = set().union(*by_number.values(), {"outer_radius_m"})
    for name, group in groups.items():
        if not effective & set(group):
            others = [other for other in groups if other != name]
            beside = f"beside {', '.join(others)} " if others else ""
            raise InputError(
                f"{name} has no effect {beside}under law {law}; accepted: quantities that the "
                "law's parameters depend on"
            )
    if law == "published" and "outer_radius_m" in names:
        raise InputError(
            "outer_radius_m: the authors' program has its nodus at 35 mm; accepted: law repaired "
            "or consistent"
        )
    of_nodus = set().union(*(by_number[name] for name in COMPLIANCES))
    if chosen.rigid and of_nodus:
        raise InputError(
            f"{sorted(of_nodus)[0]}: {chosen.label} is rigid, it has no nodus; accepted: "
            "a configuration with a nodus"
        )


def broadcast_error(values: Mapping[str, Any]) -> InputError:
    """Build the error for shapes that do not broadcast."""
    text = ", ".join(f"{name} {np.shape(value)}" for name, value in values.items())
    return InputError(f"shapes {text}; accepted: shapes that broadcast")


def float_array(name: str, value: ArrayLike, accepted: str) -> Array:
    """Return numbers of any shape as floats.

    Raises:
        InputError: text, None, lists of unequal length: anything but numbers.
    """
    try:
        raw = np.asarray(value)
        numbers = raw.astype(float)
    except (TypeError, ValueError):
        raw = np.empty(0, dtype=object)
        numbers = None
    if (
        numbers is None
        or raw.dtype.kind not in "iufO"
        or any(item is None for item in (raw.flat if raw.dtype.kind == "O" else ()))
    ):
        raise InputError(f"{name} {shown(value)} is not a number; {accepted}")
    return numbers


def _numbers(name: str, value: ArrayLike) -> Array:
    quantity = QUANTITIES[name]
    low, high = quantity.bounds
    kind = "whole numbers" if quantity.whole else "numbers"
    accepted = f"accepted: {kind} from {low:g} to {high:g} [{quantity.unit}]"
    try:
        raw = np.asarray(value)
        numbers = raw.astype(float)
    except (TypeError, ValueError):
        raise InputError(f"{name} {shown(value)} is not numeric; {accepted}") from None
    if raw.dtype.kind not in "iuf":
        raise InputError(f"{name} {shown(value)} is not numeric; {accepted}")
    if not numbers.size:
        raise InputError(f"{name} is empty; {accepted}")
    bad = ~((numbers >= low) & (numbers <= high))
    if quantity.whole:
        bad |= numbers != np.round(numbers)
    if bad.any():
        raise InputError(f"{name} {numbers[bad].flat[0]:g}; {accepted}")
    return numbers


def _material(name: str, value: Any) -> dict[str, Array]:
    library = read_library()
    known: Mapping[str, Any] = library.matrices if name == "matrix" else library.fibres
    kind = Matrix if name == "matrix" else Fibre
    items = np.array(value, dtype=object)
    if not items.size:
        raise InputError(f"{name} is empty; accepted: {', '.join(known)} or records")
    records = np.empty(items.shape, dtype=object)
    for place, item in np.ndenumerate(items):
        if not isinstance(item, kind) and not (isinstance(item, str) and item in known):
            raise unknown_name(name, item, known)
        records[place] = known[item] if isinstance(item, str) else item

    def each(take: Any) -> Array:
        return np.asarray([take(r) for r in records.ravel()], dtype=float).reshape(records.shape)

    if name == "matrix":
        return {
            "matrix_modulus_MPa": each(matrix_modulus),
            "poisson_ratio": each(lambda r: r.poisson_ratio),
        }
    return {
        "fibre_youngs_modulus_MPa": each(lambda r: r.youngs_modulus_MPa),
        "fibre_shear_modulus_MPa": each(lambda r: r.shear_modulus_MPa),
    }
