"""A propeller as somebody describes it: blade, nodus, place of the nodus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import check_number, validate
from tombo_dynamics.propeller import Blade, Configuration, Library, Nodus
from tombo_propeller.design.candidates import describe, free_number, with_nodus_at

PAPER: Final = "nine_inch"
"""Blade of the paper, which Table III was measured with."""
KNOBS: Final = {
    "fibres": ("", 0.0, 12.0, 1.0),
    "fibre_diameter_mm": ("mm", 0.1, 1.5, 0.01),
    "length_mm": ("mm", 2.0, 40.0, 0.1),
    "outer_radius_mm": ("mm", 10.0, 150.0, 0.1),
}
"""Unit, lowest, highest value and step of the parameters of a nodus."""
_KEYS: Final = ("blade", "soft", "matrix", "fibre", *KNOBS)


@dataclass(frozen=True)
class ChosenPropeller:
    """A propeller with its known figures."""

    configuration: Configuration
    blade: Blade
    """Before the nodus was put where it is."""

    @property
    def on_paper_blade(self) -> bool:
        """Whether the measurements of Table III are of its blade."""
        return self.blade.name == PAPER

    @property
    def label(self) -> str:
        """Blade and nodus in words."""
        return f"{self.blade.name}: {describe(self.configuration)}"


def propeller_choice(values: Mapping[str, Any], library: Library) -> ChosenPropeller:
    """Return the propeller that is described.

    Args:
        values: blade, matrix and fibre by name; soft; the KNOBS. Missing values are those of
        configuration 13.
        library: of blades, materials and configurations; a configuration that is described
            exactly is taken as it is.

    Raises:
        InputError: names the key, the value and the accepted ones.
    """
    for key in values:
        if key not in _KEYS:
            raise unknown_name("key of a propeller", key, _KEYS)
    blade = _named(values.get("blade", PAPER), library.blades, "blade")
    soft = values.get("soft", True)
    if not isinstance(soft, bool):
        raise InputError(f"soft: {shown(soft)}; accepted: true or false")
    placed, nodus = blade, None
    if soft:
        numbers = default_knobs(blade)
        for name, (unit, low, high, _) in KNOBS.items():
            if values.get(name) is not None:
                numbers[name] = check_number(
                    name, values[name], unit or "1", (low, high), integer=name == "fibres"
                )
        nodus = Nodus(
            _named(values.get("matrix", "DragonSkin30"), library.matrices, "matrix"),
            _named(values.get("fibre", "tendon"), library.fibres, "fibre"),
            int(numbers["fibres"]),
            numbers["fibre_diameter_mm"],
            numbers["length_mm"],
        )
        validate(nodus, "nodus")
        own = 1e3 * blade.joint.outer_radius_m
        outer = numbers["outer_radius_mm"]
        outer_m = blade.joint.outer_radius_m if abs(outer - own) < 0.05 else 1e-3 * outer
        placed = with_nodus_at(blade, outer_m, 1e-3 * nodus.length_mm)
    for known in library.configurations.values():
        if known.blade == placed and known.nodus == nodus:
            return ChosenPropeller(known, blade)
    return ChosenPropeller(Configuration(free_number(library), placed, nodus), blade)


def default_knobs(blade: Blade) -> dict[str, float]:
    """Return the nodus of configuration 13, its lengths in the size of the blade."""
    outer = 1e3 * blade.joint.outer_radius_m
    scale = outer / 35.0
    plain = {"fibres": 5.0, "fibre_diameter_mm": 0.9, "length_mm": 12.0}
    if abs(scale - 1.0) > 1e-9:
        plain["fibre_diameter_mm"] = round(min(0.9 * scale, KNOBS["fibre_diameter_mm"][2]), 2)
        plain["length_mm"] = round(12.0 * scale * 2.0) / 2.0
    return {**plain, "outer_radius_mm": round(outer, 1)}


def _named(name: object, known: Mapping[str, Any], what: str) -> Any:
    if not isinstance(name, str) or name not in known:
        raise unknown_name(what, name, known)
    return known[name]
