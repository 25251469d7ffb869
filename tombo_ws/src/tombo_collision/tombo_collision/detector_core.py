"""The detector as node, replay and headless flight run it: each pose is checked before its use.

No sample of a motion capture may raise an alarm: a pose in another frame, from the
future, long late, twice, no number, or of another body is refused, with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_collision.detector import DetectorMemory, begin_detector, detect, set_triggers
from tombo_collision.params import DetectorParams
from tombo_dynamics.core import Compiled, Core, Output
from tombo_dynamics.frames import is_map
from tombo_dynamics.input_check import MAX_POSE_AGE_NS, PoseRefusal, check_pose, is_future
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import CollisionEventRecord, DetectorStatusRecord
from tombo_dynamics.messages import ROTOR_UNKNOWN, CollisionEvent, DetectorStatus, Pose
from tombo_dynamics.records import Record, field, parameter_record

_SILENT_NS = 120_000_000
"""3.5 samples at 30 Hz."""
_LATE_NS = 100_000_000
"""An older pose is used, but a collision is known late."""
_SET_BACK_S = 1000.0
"""A clock that was set back is a step back of the detector's time by so much."""
_NONE = -1


class DetectorCoreMemory(Record):
    """Memory of the detector's core."""

    detector = field("", "what it watches with", kind=DetectorMemory)
    origin_ns = field("ns", "stamp that is time 0 of the detector; -1: none yet", kind=int)
    last_ns = field("ns", "stamp of the last pose used", kind=int)
    used = field("1", "poses used", kind=int)
    refused = field("1", "poses refused, by `PoseRefusal`", len(PoseRefusal), int)
    status = field("", "of the last pose", kind=DetectorStatusRecord)
    status_due = field("1", "it is to be published", kind=bool)
    event = field("", "the last one", kind=CollisionEventRecord)
    event_due = field("1", "it is to be published", kind=bool)


@compiled(inline=False)
def take_pose(
    memory: DetectorCoreMemory, params: DetectorParams, pose: Pose, now_ns: int
) -> PoseRefusal:
    """Take a pose in map; return why it is not used, a `PoseRefusal`.

    `status` is filled in, and `event` if there is one.
    """
    stamp_ns = pose.stamp_ns
    result = _detect(memory, params, pose, now_ns)
    fill_status(memory, params, stamp_ns, result)
    if memory.detector.collided:
        d, event = memory.detector, memory.event
        event.stamp_ns = stamp_ns
        event.trigger = d.trigger
        event.contact_stamp_ns = memory.origin_ns + int(np.rint(1e9 * d.contact_s))
        event.contact_position = d.x_c
        event.flight_direction = d.direction
        event.confidence = d.confidence
        event.statistic = d.statistic
        event.count = d.count
        event.rotor = ROTOR_UNKNOWN
        memory.event_due = True
    return result


@compiled(inline=False)
def fill_status(
    memory: DetectorCoreMemory, params: DetectorParams, stamp_ns: int, result: PoseRefusal
) -> None:
    """Count a pose and fill in the status for it."""
    status = memory.status
    status.statistic = 0.0
    if result == PoseRefusal.NONE:
        memory.used += 1
        status.statistic = memory.detector.statistic
    else:
        memory.refused[result.value] += 1
    status.stamp_ns = stamp_ns
    status.threshold = params.threshold
    status.rejected = 0
    for i in range(memory.refused.size):
        status.rejected += memory.refused[i]
    status.poses = memory.used + status.rejected
    memory.status_due = True


@compiled(inline=False)
def _detect(
    memory: DetectorCoreMemory, params: DetectorParams, pose: Pose, now_ns: int
) -> PoseRefusal:
    stamp_ns, position, attitude = pose.stamp_ns, pose.position, pose.attitude
    memory.detector.collided = False
    why = check_pose(stamp_ns, now_ns, MAX_POSE_AGE_NS, position, attitude)
    if why != PoseRefusal.NONE:
        return why
    clock_set = is_future(memory.last_ns, now_ns)
    if memory.origin_ns == _NONE or clock_set:
        memory.origin_ns = stamp_ns
        if clock_set:  # it can't be taken for one out of order
            last_s = memory.detector.last.stamp_s
            memory.origin_ns = stamp_ns - int(np.rint(1e9 * (last_s - _SET_BACK_S)))
    elif stamp_ns <= memory.last_ns:
        return PoseRefusal.OUT_OF_ORDER
    result = detect(
        memory.detector, params, 1e-9 * (stamp_ns - memory.origin_ns), position, attitude
    )
    if result == PoseRefusal.NONE:
        memory.last_ns = stamp_ns
    return result


class DetectorCore(Core):
    """Checks poses and watches the good ones for a collision."""

    name = "detector"
    inputs = ("/mocap/pose",)
    outputs: ClassVar[Mapping[str, Output]] = {
        "/collision_event": Output(CollisionEvent, "event", "event_due"),
        "/detector/status": Output(DetectorStatus, "status", "status_due"),
    }
    compiled = Compiled(("memory",), ("params",), {"/mocap/pose": take_pose})
    period_ns = 20_000_000
    sections: ClassVar[Mapping[str, type]] = {"detector": DetectorParams}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> DetectorCore:
        """Return a new detector."""
        return cls(records["detector"])

    def __init__(self, params: DetectorParams) -> None:
        super().__init__()
        self.memory = DetectorCoreMemory.new()
        begin_detector(self.memory.detector)
        self.memory.origin_ns = _NONE
        self.set_params("detector", params)
        self._pose_ns: int | None = None

    def on(self, topic: str, message: Pose, now_ns: int) -> None:
        """Take a pose."""
        memory, stamp_ns = self.memory, message.stamp_ns
        result = PoseRefusal.NONE
        if topic in self.contested:
            result = PoseRefusal.TWO_PUBLISHERS
        elif not is_map(message.frame_id):
            result = PoseRefusal.WRONG_FRAME
        if result:
            fill_status(memory, self.params, stamp_ns, result)
            self._published += self.take_due()
        else:
            result = self.take(topic, message, now_ns + self.clock_slack_ns)
        self._pose_ns = now_ns
        health = self.health
        if not result and memory.detector.collided:
            health.values["collisions"] = int(memory.event.count)
        health.values["poses"] = int(memory.status.poses)
        if result:
            health.values[f"refused.{result.key}"] = int(memory.refused[result])
            health.report_event(f"pose_{result.key}", result.text)
        elif now_ns - stamp_ns > _LATE_NS:
            health.report_event("mocap_late", "poses come more than 0.1 s after their capture")

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return the messages of the poses since the last step."""
        silent = self._pose_ns is not None and now_ns - self._pose_ns > _SILENT_NS
        self.health.fault("mocap_silent", silent, "no mocap poses: no collision can be seen")
        return super().step(now_ns)

    def set_params(self, section: str, params: DetectorParams) -> None:
        """Go on with other parameters; earlier samples stay."""
        self.params = parameter_record(params)
        set_triggers(self.memory.detector, params)
