"""Wind that new flights have and healthy ones have not: nothing of the vehicle has changed then.

Wind leans the vehicle and asks for other commands, as other causes do: where the new flights are
pushed sideways otherwise than the healthy ones, none of these is named.
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
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter
from tombo_logs.checks.wind import DRAG_KNOWN, LEAST

_SAME = 0.5
"""Share of the healthy flights' push within which the new ones have the same wind."""
_RELEVELLED = 0.2
"""Standard deviation of the apparent acceleration after a new levelling of the map, or a new
definition of the body [m/s^2]: 1.2 deg."""
_SUSPECTED_SIGMAS, _CERTAIN_SIGMAS = 2.0, 4.0
"""Standard deviations of a difference from which on there may be wind, and from which there is."""


@dataclass(frozen=True)
class NewWind:
    """Wind of new flights, more than the healthy ones have."""

    speed: Array | None
    """(2,) along map x, y [m/s], by a drag in proportion to the speed; None: not known, without
    the drag, or as the level may be another."""
    deviation: float
    """Standard deviation of each [m/s]."""
    own_speed: float = 0.0
    """Speed of the flights that show the drag [m/s]."""

    @property
    def by_square(self) -> float:
        """Share of `speed` if drag grows with the square of the speed from `own_speed` on."""
        assert self.speed is not None
        return math.sqrt(self.own_speed / float(np.linalg.norm(self.speed)))

    def change(self, confidence: float) -> tuple[Change, ...]:
        """Return it as what has changed; nothing where its speed is not known.

        The interval holds both laws of drag.
        """
        if self.speed is None:
            return ()
        half = TWO_SIDED * self.deviation
        theta = tuple(
            FittedParameter(
                name, "m/s", 0.0, v, min(v, v * self.by_square) - half,
                max(v, v * self.by_square) + half,
            )
            for name, v in zip(("east", "north"), self.speed.tolist(), strict=True)
        )  # fmt: skip
        return (Change("steady_wind", "", theta, confidence),)

    @property
    def summary(self) -> str:
        """In a sentence or two."""
        if self.speed is None:
            return (
                "The new flights are pushed sideways more than the healthy ones: by wind of a "
                "speed that they do not show, or their level is another. What else may have "
                "changed is not told then."
            )
        size = float(np.linalg.norm(self.speed))
        return (
            f"There is wind in the new flights: air of {size:.1f} m/s more than in the healthy "
            "ones, if drag grows in proportion to the speed, as that of rotors does; "
            f"{size * self.by_square:.1f} m/s if it grows with the square, as that of a body "
            "does. What else may have changed is not told in wind."
        )


def new_wind(new: Sequence[Flight], healthy: Sequence[Flight]) -> NewWind | None:
    """Return the wind of the new flights; None: there is none, or the healthy ones have it, too.

    A tilt of body, accelerometer or map is the same in both. It drops out of their difference,
    which therefore shows the wind. `new` and `healthy` are checked.
    """
    after, before = (
        [p for log in logs if (p := push_in(log)) is not None] for logs in (new, healthy)
    )
    if not after or not before:
        windy = 2 * len(windy_flights(new)) > len(new) and not windy_flights(healthy)
        return NewWind(None, math.inf) if windy else None
    steady = [np.array([p.steady for p in pushes]) for pushes in (after, before)]
    now, old = (each.mean(axis=0) for each in steady)
    size = float(np.linalg.norm(now - old))
    doubt = math.hypot(_between_flights(*steady), _RELEVELLED)
    if size < max(LEAST, _SUSPECTED_SIGMAS * doubt, _SAME * float(np.linalg.norm(old))):
        return None
    drag, deviation = drag_shown([*after, *before])
    if size < _CERTAIN_SIGMAS * doubt or not deviation < DRAG_KNOWN * drag:
        return NewWind(None, math.inf)
    own_speed = float(np.mean([p.speed for p in (*after, *before)]))
    speed = (now - old) / drag
    return NewWind(speed, math.hypot(doubt / drag, deviation / drag * size / drag), own_speed)


def _between_flights(after: Array, before: Array) -> float:
    """Return the deviation of the difference of means of pushes (N, 2), from their scatter.

    Of one flight on each side it is not known, and 0.
    """
    free = len(after) + len(before) - 2
    squares = sum(float(np.sum((each - each.mean(axis=0)) ** 2)) for each in (after, before))
    return math.sqrt(squares / (2 * max(free, 1)) * (1.0 / len(after) + 1.0 / len(before)))
