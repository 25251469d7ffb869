"""Wind that new flights have and healthy ones have not: nothing of the vehicle has changed then.

Wind leans the vehicle and asks for other commands, as other causes do: where the checks see it,
none of these is named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_bag.flight import Flight
from tombo_diagnosis.diagnosis import Change
from tombo_diagnosis.engine.cause_estimates import TWO_SIDED
from tombo_diagnosis.flight.calibrate import drag_shown, push_in, windy_flights
from tombo_diagnosis.flight.fit.track import WIND
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter
from tombo_logs.checks.wind import DRAG_KNOWN, LEAST

_SAME = 0.5
"""Share of the new flights' push within which the healthy ones have the same wind."""


@dataclass(frozen=True)
class NewWind:
    """Wind of new flights, more than the healthy ones have."""

    speed: Array | None
    """(2,) along map x, y [m/s]; None: not known, without the drag, or as it swings."""
    deviation: float
    """Of each [m/s]."""

    def change(self, confidence: float) -> tuple[Change, ...]:
        """Return it as what has changed; nothing where its speed is not known."""
        if self.speed is None:
            return ()
        half = TWO_SIDED * self.deviation
        theta = tuple(
            FittedParameter(name, "m/s", 0.0, v, v - half, v + half)
            for name, v in zip(("east", "north"), self.speed.tolist(), strict=True)
        )
        return (Change(WIND, "", theta, confidence),)

    @property
    def summary(self) -> str:
        """In a sentence or two."""
        if self.speed is None:
            return (
                "There is wind in the new flights, of a speed that they do not show; what else "
                "may have changed is not told in wind."
            )
        return (
            f"There is wind in the new flights: air of {np.linalg.norm(self.speed):.1f} m/s more "
            "than in the healthy ones. What else may have changed is not told in wind."
        )


def new_wind(new: Sequence[Flight], healthy: Sequence[Flight]) -> NewWind | None:
    """Return the wind of most new flights; None: there is none, or the healthy ones have it, too.

    `new` and `healthy` are checked.
    """
    windy = windy_flights(new)
    if 2 * len(windy) <= len(new):
        return None
    after = [push for log in windy if (push := push_in(log)) is not None]
    before = [push for log in healthy if (push := push_in(log)) is not None]
    if not after or not before:
        return None if windy_flights(healthy) else NewWind(None, math.inf)
    now, old = (np.mean([p.steady for p in pushes], axis=0) for pushes in (after, before))
    size = float(np.linalg.norm(now - old))
    if max(p.swing for p in after) == 0.0 and size < max(LEAST, _SAME * np.linalg.norm(now)):
        return None
    drag, deviation = drag_shown([*after, *before])
    if size < LEAST or not deviation < DRAG_KNOWN * drag:
        return NewWind(None, math.inf)
    doubt = math.hypot(*(np.mean([p.deviation for p in pushes]) for pushes in (after, before)))
    speed = (now - old) / drag
    return NewWind(speed, math.hypot(doubt / drag, deviation / drag * size / drag))
