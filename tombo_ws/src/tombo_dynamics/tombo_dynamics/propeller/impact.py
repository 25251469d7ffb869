"""What a propeller configuration does on impact: measured, or as its like do."""

from __future__ import annotations

from collections.abc import Iterable

from tombo_dynamics.propeller.mounted_propeller import (
    PropellerChoice,
    library_of,
    mounted_configuration,
)
from tombo_dynamics.propeller.records import Configuration


def recovery_time(propeller: PropellerChoice) -> float:
    """Return how long a folded propeller needs for 90 % of its thrust [s]; 0: it does not fold."""
    if not propeller.folds:
        return 0.0
    known = library_of(propeller).configurations.values()
    return propeller_performance(mounted_configuration(propeller), known)["recovery_s"]


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
