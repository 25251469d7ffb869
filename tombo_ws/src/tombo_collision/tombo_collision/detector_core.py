"""The detector as node, replay and headless flight run it: each pose is checked before its use.

Nothing that a motion capture can deliver may raise an alarm: a pose in another frame, from the
future, long late, twice, no number, or of another body is refused, with the reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_collision.detector import (
    EVENT,
    JUMP,
    JUMPED_POSE,
    NOT_FINITE,
    NOT_FINITE_POSE,
    OUT_OF_ORDER,
    OUT_OF_ORDER_POSE,
    DetectorMemory,
    begin_detector,
    detect,
    set_triggers,
)
from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Core
from tombo_dynamics.jit import compiled_call
from tombo_dynamics.message_records import CollisionEventRecord, DetectorStatusRecord, message_of
from tombo_dynamics.messages import CollisionEvent, DetectorStatus, Pose
from tombo_dynamics.records import Record, field, parameter_record

FRAME = "map"
WRONG_FRAME, NOT_UNIT, FUTURE, LATE = "wrong_frame", "not_unit", "future", "late"
TWO_PUBLISHERS = "two_publishers"
_, _, _, _, _, _WRONG_FRAME, _NOT_UNIT, _FUTURE, _LATE, _TWO_PUBLISHERS = range(10)
REASONS = {
    NOT_FINITE_POSE: NOT_FINITE,
    OUT_OF_ORDER_POSE: OUT_OF_ORDER,
    JUMPED_POSE: JUMP,
    _WRONG_FRAME: WRONG_FRAME,
    _NOT_UNIT: NOT_UNIT,
    _FUTURE: FUTURE,
    _LATE: LATE,
    _TWO_PUBLISHERS: TWO_PUBLISHERS,
}
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
_NONE = -1


class DetectorCoreMemory(Record):
    """Memory of the detector's core."""

    detector = field("", "what it watches with", kind=DetectorMemory)
    origin_ns = field("ns", "stamp that is time 0 of the detector; -1: none yet", kind=int)
    last_ns = field("ns", "stamp of the last pose used", kind=int)
    used = field("1", "poses used", kind=int)
    refused = field("1", "poses refused, by reason", 10, int)
    status = field("", "of the last pose", kind=DetectorStatusRecord)
    event = field("", "the last one", kind=CollisionEventRecord)


@compiled_call
def begin_detector_core(memory: DetectorCoreMemory) -> None:
    """Begin before the first pose."""
    begin_detector(memory.detector)
    memory.origin_ns = _NONE


@compiled_call
def take_pose(
    memory: DetectorCoreMemory,
    params: DetectorParams,
    stamp_ns: int,
    now_ns: int,
    position: Array,
    attitude: Array,
) -> int:
    """Take a pose in map; return what became of it: used (0), `EVENT` or a key of `REASONS`.

    `status` is filled in, and `event` if there is one.

    Args:
        memory: of the core.
        params: of the detector.
        stamp_ns: capture time.
        now_ns: the present, on the same clock.
        position: (3) [m].
        attitude: quaternion xyzw (4), map from base_link.
    """
    result = _look_at(memory, params, stamp_ns, now_ns, position, attitude)
    fill_status(memory, params, stamp_ns, result)
    if result == EVENT:
        d, event = memory.detector, memory.event
        event.stamp_ns = stamp_ns
        event.trigger = d.trigger
        event.contact_stamp_ns = memory.origin_ns + int(np.rint(1e9 * d.contact_s))
        for i in range(3):
            event.contact_position[i] = d.x_c[i]
            event.flight_direction[i] = d.direction[i]
        event.confidence = d.confidence
        event.statistic = d.statistic
        event.count = d.count
    return result


@compiled_call
def fill_status(
    memory: DetectorCoreMemory, params: DetectorParams, stamp_ns: int, result: int
) -> None:
    """Count a pose and fill in the status for it."""
    used = result <= EVENT
    status = memory.status
    status.statistic = 0.0
    if used:
        memory.used += 1
        status.statistic = memory.detector.statistic
    else:
        memory.refused[result] += 1
    status.stamp_ns = stamp_ns
    status.threshold = params.threshold
    status.rejected = 0
    for i in range(memory.refused.size):
        status.rejected += memory.refused[i]
    status.poses = memory.used + status.rejected


@compiled_call
def _look_at(
    memory: DetectorCoreMemory,
    params: DetectorParams,
    stamp_ns: int,
    now_ns: int,
    position: Array,
    attitude: Array,
) -> int:
    square = 0.0
    for i in range(4):
        square += attitude[i] * attitude[i]
    if not math.isfinite(square):
        return NOT_FINITE_POSE
    if abs(math.sqrt(square) - 1.0) > _NORM:
        return _NOT_UNIT
    if stamp_ns > now_ns + _MAX_FUTURE_NS:
        return _FUTURE
    if stamp_ns < now_ns - _MAX_AGE_NS:
        return _LATE
    clock_set = memory.last_ns > now_ns + _MAX_FUTURE_NS
    if memory.origin_ns == _NONE or clock_set:
        if clock_set:  # take it whatever its stamp is, and start anew there
            memory.detector.last.stamp_s = math.inf
        memory.origin_ns = stamp_ns
    elif stamp_ns <= memory.last_ns:
        return OUT_OF_ORDER_POSE
    result = detect(
        memory.detector, params, 1e-9 * (stamp_ns - memory.origin_ns), position, attitude
    )
    if result <= EVENT:
        memory.last_ns = stamp_ns
    return result


class DetectorCore(Core):
    """Checks poses and watches the good ones for a collision."""

    name = "detector"
    inputs = ("/mocap/pose",)
    outputs = ("/collision_event", "/detector/status")
    period_ns = 20_000_000
    sections: ClassVar[Mapping[str, type]] = {"detector": DetectorParams}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> DetectorCore:
        """Return a new detector."""
        return cls(records["detector"])

    def __init__(self, params: DetectorParams) -> None:
        super().__init__()
        self.memory = DetectorCoreMemory.new()
        begin_detector_core(self.memory)
        self.set_params("detector", params)
        self._outputs: list[tuple[str, Any]] = []
        self._pose_ns: int | None = None
        self._several = False

    def on(self, topic: str, message: Pose, now_ns: int) -> None:
        """Take a pose."""
        memory, stamp_ns = self.memory, message.stamp_ns
        result = _WRONG_FRAME
        if self._several:
            result = _TWO_PUBLISHERS
        if self._several or message.frame_id.lstrip("/") != FRAME:
            fill_status(memory, self.params, stamp_ns, result)
        else:
            clock_ns = now_ns + self.clock_slack_ns
            result = take_pose(
                memory, self.params, stamp_ns, clock_ns, message.position, message.attitude
            )
        self._pose_ns = now_ns
        health = self.health
        if result == EVENT:
            health.values["collisions"] = int(memory.event.count)
            event = message_of(CollisionEvent, memory.event, frame_id=FRAME)
            self._outputs.append(("/collision_event", event))
        self._outputs.append(("/detector/status", message_of(DetectorStatus, memory.status)))
        health.values["poses"] = int(memory.status.poses)
        if result in REASONS:
            reason = REASONS[result]
            health.values[f"refused.{reason}"] = int(memory.refused[result])
            health.report_event(f"pose_{reason}", _REFUSALS[reason])
        elif now_ns - stamp_ns > _LATE_NS:
            health.report_event("mocap_late", "poses come more than 0.1 s after their capture")

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return what the poses since the last step gave."""
        silent = self._pose_ns is not None and now_ns - self._pose_ns > _SILENT_NS
        self.health.fault("mocap_silent", silent, "no mocap poses: no collision can be seen")
        outputs, self._outputs = self._outputs, []
        return outputs

    def set_params(self, section: str, params: DetectorParams) -> None:
        """Go on with other parameters; what was seen so far stays."""
        self.params = parameter_record(params)
        set_triggers(self.memory.detector, params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Refuse poses of several publishers: nobody can tell which is true."""
        self._several = several

    @property
    def refused(self) -> Counter[str]:
        """How many poses were refused, by reason."""
        counts = self.memory.refused
        return Counter({name: int(counts[i]) for i, name in REASONS.items() if counts[i]})
