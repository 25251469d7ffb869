"""From a vehicle and its propeller to their effects: strike, wear, scatter, frame contact."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tombo_dynamics.effects import REGISTRY, check_theta
from tombo_dynamics.propeller.mounted_propeller import (
    PropellerChoice,
    library_of,
    mounted_configuration,
    mounted_rotors,
    propeller_performance,
)
from tombo_dynamics.rotor_maps import hover_point
from tombo_dynamics.vehicle import VehicleParams

_TOMBO_STRIKES = 3.0
"""Full strikes that a Tombo blade stands (paper: about three collisions a propeller)."""
_RIGID_STRIKES = 0.01
"""Share of a full strike that breaks a rigid blade: any real strike does."""


_RIGID_CONF = 0
_HOVER_SPEED = 512.0
"""rad/s: the paper's vehicle hovers at this speed (1.3 kg, configuration 13)."""
_STRONGEST_PUSH = 4.0
"""Of the paper's: the bounds of the effect's peak force."""


_SLANT = 0.4
"""rad, estimated, because: a blade enters the obstacle by 2.5 mm between two passes at 0.8 m/s, so
it meets the surface at acos(1 - 2.5/111) = 0.21 rad; friction of 0.2 adds to it: atan(0.41)."""


_DURATION = 0.014
"""s, calibrated: the push of a strike lasts long enough to give the paper's unstable phase and
falling distance (1.5 s, 0.5 m): 145.5 N fading over it, about one turn, are 1.0 N s."""


def vehicle_effects(
    propeller: PropellerChoice, vehicle: VehicleParams, given: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Return the given effects, completed by the effects of propeller and frame.

    Given parameters stay. The frame meets an obstacle with the typical stiffness and
    damping of `contact_force`: an obstacle is solid unless a stiffness of 0 is given. The push of
    a plain propeller, or of one with a nodus, is the paper's, scaled by spin momentum over radius.
    The strike energy that it withstands scales with its energy in hover.
    """
    folds = propeller.folds
    known = library_of(propeller).configurations
    struck = propeller if folds or not propeller.plain else replace(propeller, conf=_RIGID_CONF)
    performance = propeller_performance(mounted_configuration(struck), known.values())
    push, energy, strikes = 1.0, 1.0, _TOMBO_STRIKES if folds else _RIGID_STRIKES
    if propeller.plain:
        push, energy = _strength(propeller, vehicle)
        strikes = 0.0 if propeller.on_impact in ("", "rigid") else strikes
    derived: Mapping[str, Mapping[str, float]] = {
        "blade_strike": {
            "peak_force": push * performance["collision_force_N"],
            "recovery_time": performance["recovery_s"],
            "slant": _SLANT,
            "duration": _DURATION,
        },
        "propeller_wear": {"collisions": energy * strikes},
        "thrust_scatter": {"deviation": propeller.matched},
        "contact_force": {p.name: p.typical for p in REGISTRY["contact_force"].theta},
    }
    effects = {name: dict(values) for name, values in given.items()}
    for name, values in derived.items():
        effects[name] = {**values, **effects.get(name, {})}
    return check_theta(effects, "effects")


def _strength(propeller: PropellerChoice, vehicle: VehicleParams) -> tuple[float, float]:
    """Return spin momentum over radius, and energy, of a rotor in hover over the paper's."""
    maps = mounted_rotors(propeller, vehicle)
    faster = hover_point(maps, vehicle).speed / _HOVER_SPEED
    paper = VehicleParams()
    momentum = vehicle.rotor_inertia / paper.rotor_inertia * faster
    push = momentum * paper.rotor_radius / vehicle.rotor_radius
    return min(push, _STRONGEST_PUSH), momentum * faster
