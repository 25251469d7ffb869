"""From a propeller configuration to its map and its effects: strike, wear, scatter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tombo_dynamics.effects import check_theta
from tombo_dynamics.propeller import ThrustMap, thrust_map
from tombo_dynamics.propeller.mounted_propeller import (
    PropellerChoice,
    library_of,
    mounted_configuration,
)
from tombo_dynamics.propeller.records import Configuration

_TOMBO_STRIKES = 3.0
"""Full strikes that a Tombo blade stands (paper: about three collisions a propeller)."""
_RIGID_STRIKES = 0.01
"""Share of a full strike that breaks a rigid blade: any real strike does."""


_SLANT = 0.4
"""rad, estimated, because: a blade enters the obstacle by 2.5 mm between two passes at 0.8 m/s, so
it meets the surface at acos(1 - 2.5/111) = 0.21 rad; friction of 0.2 adds to it: atan(0.41)."""


_DURATION = 0.014
"""s, calibrated: the push of a strike lasts long enough to give the paper's unstable phase and
falling distance (1.5 s, 0.5 m): 145.5 N fading over it, about one turn, are 1.0 N s."""


def thrust_map_of(choice: PropellerChoice) -> ThrustMap:
    """Return the thrust map of a configuration under a law of the nodus."""
    return thrust_map(mounted_configuration(choice), law=choice.law)


def propeller_performance(
    wanted: Configuration, known: Iterable[Configuration]
) -> dict[str, float]:
    """Return Table III's figures that the simulation uses for a configuration.

    A configuration that was not measured, such as 1 to 4, gets the mean over the measured ones
    with the same silicone, or over all where there is none. The rigid propeller has no recovery.

    Args:
        wanted: the configuration.
        known: those whose measurements may stand in.

    Returns:
        collision_force_N, recovery_s (0 for the rigid one).
    """
    others = tuple(known)
    performance = {}
    for name in ("collision_force_N", "recovery_s"):
        value = getattr(wanted.measured, name) if wanted.measured is not None else None
        if value is None:
            value = 0.0 if wanted.nodus is None else _same_matrix_mean(wanted, others, name)
        performance[name] = float(value)
    return performance


def _same_matrix_mean(wanted: Configuration, known: Iterable[Configuration], name: str) -> float:
    """Return the mean of a measured figure over the same silicone, else over every nodus."""
    same, every = [], []
    for other in known:
        value = getattr(other.measured, name) if other.measured is not None else None
        if other.nodus is None or wanted.nodus is None or value is None:
            continue
        every.append(float(value))
        if other.nodus.matrix.name == wanted.nodus.matrix.name:
            same.append(float(value))
    values = same or every
    return sum(values) / len(values)


def propulsion_effects(
    propeller: PropellerChoice, given: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Return the given effects with those that follow from the propeller filled in.

    What is given about an effect stays.
    """
    wanted = mounted_configuration(propeller)
    performance = propeller_performance(wanted, library_of(propeller).configurations.values())
    derived: Mapping[str, Mapping[str, float]] = {
        "blade_strike": {
            "peak_force": performance["collision_force_N"],
            "recovery_time": performance["recovery_s"],
            "slant": _SLANT,
            "duration": _DURATION,
        },
        "propeller_wear": {"collisions": _RIGID_STRIKES if wanted.rigid else _TOMBO_STRIKES},
        "thrust_scatter": {"deviation": propeller.matched},
    }
    effects = {name: dict(values) for name, values in given.items()}
    for name, values in derived.items():
        effects[name] = {**values, **effects.get(name, {})}
    return check_theta(effects, "effects")
