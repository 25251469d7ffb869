"""Mass, limits and confidence for the design of a propeller."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from tombo_dynamics.params import check_number

LEAST_MARGIN = 1.1
"""The simulator flies nothing with less thrust than this over weight."""


def _limit(unit: str, low: float, high: float, doc: str, default: Any = None) -> Any:
    metadata = {"unit": unit, "bounds": (low, high), "doc": doc}
    return dataclasses.field(default=default, metadata=metadata)


def option_of(field: dataclasses.Field[Any]) -> str:
    """Return the option that sets a field: its name without the unit."""
    name = field.name.removesuffix(f"_{field.metadata['unit']}")
    return f"--{name.replace('_', '-')}"


@dataclass(frozen=True, kw_only=True)
class DesignLimits:
    """Numbers of a request; a limit that is None is not asked for."""

    mass_kg: float = _limit("kg", 0.2, 10.0, "Mass at take-off.", dataclasses.MISSING)
    min_thrust_margin: float = _limit(
        "1", LEAST_MARGIN, 20.0, "Usable thrust over weight, at least.", 2.0
    )
    max_collision_force_N: float | None = _limit("N", 1.0, 1000.0, "At 2000 rpm, as in Table III.")
    max_recovery_s: float | None = _limit("s", 0.01, 5.0, "Until a blade is straight again.")
    max_noise_dB: float | None = _limit("dB", 1.0, 200.0, "At 2000 rpm, 5 m away.")
    min_lift_over_drag: float | None = _limit("1", 0.01, 100.0, "In hover.")
    confidence: float = _limit(
        "1", 0.5, 0.999, "Probability that a predicted figure keeps to its limit.", 0.9
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds.

        Raises:
            InputError: names the option, the value and the bounds.
        """
        for field in dataclasses.fields(self):
            value, meta = getattr(self, field.name), field.metadata
            if "bounds" in meta and value is not None:
                check_number(option_of(field), value, meta["unit"], meta["bounds"])
