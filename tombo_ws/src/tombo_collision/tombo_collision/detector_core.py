"""The detector as node and replay call it: stamps in ns, every pose looked at before it is used.

Nothing that a motion capture can deliver may raise an alarm: a pose in another frame, from the
future, long late, twice, no number, or of another body is refused, with the reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
from tombo_dynamics.core import Core
from tombo_dynamics.messages import CollisionEvent as CollisionMessage
from tombo_dynamics.messages import DetectorStatus, Pose, Trigger

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
_SILENT_NS = 120_000_000
"""Three samples at 30 Hz and a half."""
_LATE_NS = 100_000_000
"""An older pose is used, but a collision is known late."""
_REFUSALS = {
    WRONG_FRAME: "a pose whose frame is not map",
    NOT_FINITE: "a pose with NaN or infinity",
    NOT_UNIT: "a pose whose quaternion is no rotation",
    FUTURE: "a pose stamped in the future",
    OUT_OF_ORDER: "a pose not newer than the one before",
    LATE: "a pose more than half a second old",
    JUMP: "a pose where no strike could have put the vehicle: markers mixed up?",
    TWO_PUBLISHERS: "two nodes publish poses: nobody can tell which is true",
}
_TRIGGERS = {"region": Trigger.REGION, "innovation": Trigger.INNOVATION}


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


class DetectorCore(Core):
    """Checks poses and hands the good ones to a `CollisionDetector`."""

    name = "detector"
    inputs = ("/mocap/pose",)
    outputs = ("/collision_event", "/detector/status")
    period_ns = 20_000_000
    sections = {"detector": DetectorParams}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> DetectorCore:
        """Return a new detector."""
        return cls(records["detector"])

    def __init__(self, params: DetectorParams) -> None:
        super().__init__()
        self._params = params
        self._detector = CollisionDetector(params)
        self._outputs: list[tuple[str, Any]] = []
        self._pose_ns: int | None = None
        self._several = False
        self._origin: int | None = None
        self._last = 0
        self._used = 0
        self.refused: Counter[str] = Counter()
        """How many poses were refused, by reason."""

    def on(self, topic: str, message: Pose, now_ns: int) -> None:
        """Take a pose."""
        stamp_ns = message.stamp_ns
        if self._several:
            output = self.refuse(TWO_PUBLISHERS)
        else:
            output = self.pose(
                stamp_ns,
                now_ns + self.clock_slack_ns,
                message.frame_id,
                message.position,
                message.attitude,
            )
        self._pose_ns = now_ns
        if output.event is not None:
            self.health.values["collisions"] = output.event.count
            self._outputs.append(("/collision_event", _message(output, stamp_ns)))
        threshold = self._params.threshold
        status = DetectorStatus(stamp_ns, output.statistic, threshold, self.poses, self.rejected)
        self._outputs.append(("/detector/status", status))
        self.health.values["poses"] = self.poses
        if output.refused:
            self.health.values[f"refused.{output.refused}"] = self.refused[output.refused]
            self.health.report_event(f"pose_{output.refused}", _REFUSALS[output.refused])
        elif now_ns - stamp_ns > _LATE_NS:
            self.health.report_event(
                "mocap_late", "poses come more than 0.1 s after their capture"
            )

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return what the poses since the last step gave."""
        silent = self._pose_ns is not None and now_ns - self._pose_ns > _SILENT_NS
        self.health.fault("mocap_silent", silent, "no mocap poses: no collision can be seen")
        outputs, self._outputs = self._outputs, []
        return outputs

    def set_params(self, section: str, params: DetectorParams) -> None:
        """Go on with other parameters; what was seen so far stays."""
        self._params = params
        self._detector.set_params(params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Refuse poses of several publishers: nobody can tell which is true."""
        self._several = several

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


def _message(output: DetectorOutput, stamp_ns: int) -> CollisionMessage:
    event = output.event
    assert event is not None
    return CollisionMessage(
        stamp_ns,
        FRAME,
        _TRIGGERS[event.trigger],
        output.contact_ns,
        event.x_c,
        event.flight_direction,
        event.confidence,
        event.statistic,
        event.count,
    )
