"""The detector as node and replay call it: stamps in ns, every pose looked at before it is used.

Nothing that a motion capture can deliver may raise an alarm: a pose in another frame, from the
future, long late, twice, no number, or of another body is refused, with the reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector import (
    JUMP,
    NOT_FINITE,
    OUT_OF_ORDER,
    CollisionDetector,
    CollisionEvent,
)
from tombo_collision.params import DetectorParams

Array = NDArray[np.float64]

FRAME = "map"
WRONG_FRAME, NOT_UNIT, FUTURE, LATE = "wrong_frame", "not_unit", "future", "late"
TWO_PUBLISHERS = "two_publishers"
REASONS = (WRONG_FRAME, NOT_FINITE, NOT_UNIT, FUTURE, LATE, OUT_OF_ORDER, JUMP, TWO_PUBLISHERS)
"""Why a pose can be refused."""

_MAX_FUTURE_NS = 5_000_000
"""A stamp may be this far ahead of now: two clocks that are kept in step differ by less."""
_MAX_AGE_NS = 500_000_000
"""An older pose says nothing about the vehicle any more."""
_NORM = 0.1
"""A quaternion's norm may be off by this: what is further off was never an attitude."""


@dataclass(frozen=True)
class DetectorOutput:
    """What the detector made of one pose."""

    event: CollisionEvent | None
    """Its times in seconds lose the last digits of a stamp; `contact_ns` and the pose's do not."""
    statistic: float
    """Normalised innovation squared; 0 where there was none."""
    refused: str = ""
    """Why the pose was not used, one of `REASONS`; empty if it was."""
    contact_ns: int = 0
    """Estimated time of contact of the event."""


class DetectorCore:
    """Checks poses and hands the good ones to a `CollisionDetector`."""

    def __init__(self, params: DetectorParams) -> None:
        self._detector = CollisionDetector(params)
        self._origin: int | None = None
        self._last = 0
        self._used = 0
        self.refused: Counter[str] = Counter()
        """How many poses were refused, by reason."""

    def set_params(self, params: DetectorParams) -> None:
        """Go on with other parameters; what was seen so far stays."""
        self._detector.set_params(params)

    @property
    def poses(self) -> int:
        """Poses that came."""
        return self._used + self.rejected

    @property
    def rejected(self) -> int:
        """Poses refused, for whatever reason."""
        return self.refused.total()

    def pose(
        self,
        stamp_ns: int,
        now_ns: int,
        frame_id: str,
        position: Array | Sequence[float],
        attitude: Array | Sequence[float],
    ) -> DetectorOutput:
        """Take a pose.

        Args:
            stamp_ns: capture time.
            now_ns: the present, on the same clock.
            frame_id: must be map.
            position: (3) [m].
            attitude: quaternion xyzw (4), map from base_link.
        """
        q = np.asarray(attitude, dtype=np.float64)
        norm = math.hypot(*q.tolist())
        if frame_id.lstrip("/") != FRAME:
            return self.refuse(WRONG_FRAME)
        if norm != norm or norm == math.inf:
            return self.refuse(NOT_FINITE)
        if abs(norm - 1.0) > _NORM:
            return self.refuse(NOT_UNIT)
        if stamp_ns > now_ns + _MAX_FUTURE_NS:
            return self.refuse(FUTURE)
        if stamp_ns < now_ns - _MAX_AGE_NS:
            return self.refuse(LATE)
        clock_set = self._last > now_ns + _MAX_FUTURE_NS
        if self._origin is None or clock_set:
            if clock_set:
                self._detector.reset_clock()
            self._origin = stamp_ns
        elif stamp_ns <= self._last:
            return self.refuse(OUT_OF_ORDER)
        p = np.asarray(position, dtype=np.float64)
        event = self._detector.update(1e-9 * (stamp_ns - self._origin), p, q)
        if self._detector.refused:
            return self.refuse(self._detector.refused)
        self._last = stamp_ns
        self._used += 1
        if event is None:
            return DetectorOutput(None, self._detector.statistic)
        contact_ns = self._origin + round(1e9 * event.contact_time_s)
        event = replace(event, stamp_s=1e-9 * stamp_ns, contact_time_s=1e-9 * contact_ns)
        return DetectorOutput(event, event.statistic, "", contact_ns)

    def refuse(self, reason: str) -> DetectorOutput:
        """Count a pose as refused; called from outside for what a pose alone does not show."""
        self.refused[reason] += 1
        return DetectorOutput(None, 0.0, reason)
