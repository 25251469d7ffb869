"""The detector as a node: mocap poses in, collisions out, and what it made of each pose."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

from tombo_bag.topics import COLLISION_EVENT, DETECTOR_STATUS, MOCAP_POSE
from tombo_collision.detector_core import TWO_PUBLISHERS, DetectorCore, DetectorOutput
from tombo_collision.params import DetectorParams
from tombo_msgs.msg import CollisionEvent, DetectorStatus
from tombo_ros.conversion import array, point, to_ns, to_time, vector
from tombo_ros.node_loop import LoopNode, run

_SILENT_NS = 120_000_000
"""Three samples at 30 Hz and a half."""
_LATE_NS = 100_000_000
"""An older pose is used, but a collision is known late."""
_REFUSALS = {
    "wrong_frame": "a pose whose frame is not map",
    "not_finite": "a pose with NaN or infinity",
    "not_unit": "a pose whose quaternion is no rotation",
    "future": "a pose stamped in the future",
    "out_of_order": "a pose not newer than the one before",
    "late": "a pose more than half a second old",
    "jump": "a pose where no strike could have put the vehicle: markers mixed up?",
    "two_publishers": "two nodes publish poses: nobody can tell which is true",
}
_TRIGGERS = {
    "region": CollisionEvent.TRIGGER_REGION,
    "innovation": CollisionEvent.TRIGGER_INNOVATION,
}


class DetectorNode(LoopNode):
    """Runs `DetectorCore` on each pose."""

    def __init__(self) -> None:
        """Declare parameters and topics."""
        super().__init__("detector", 200.0, {"detector": DetectorParams()})
        self._core = DetectorCore(self.records["detector"])
        self._poses = self.subscribe(MOCAP_POSE, depth=20)
        self._events = self.advertise(COLLISION_EVENT)
        self._status = self.advertise(DETECTOR_STATUS)
        self._pose_ns: int | None = None
        self._known = 0

    def on_parameters_changed(self, name: str) -> None:
        """Take new parameters in flight."""
        self._core.set_params(name, self.records["detector"])

    def step(self, now_ns: int) -> None:
        """Take poses."""
        # arrivals are stamped by the system's clock, whatever the node's
        multiple_publishers = self._poses.multiple_publishers(time.time_ns())
        for taken in self._poses.take():
            self._take(taken.message, now_ns, multiple_publishers)
        silent = self._pose_ns is not None and now_ns - self._pose_ns > _SILENT_NS
        self.health.fault("mocap_silent", silent, "no mocap poses: no collision can be seen")

    def _take(self, message: Any, now_ns: int, multiple_publishers: bool) -> None:
        stamp_ns = to_ns(message.header.stamp)
        if multiple_publishers:
            output = self._core.refuse(TWO_PUBLISHERS)
        else:
            output = self._core.pose(
                stamp_ns,
                now_ns + self.slack_ns,
                message.header.frame_id,
                array(message.pose.position),
                array(message.pose.orientation),
            )
        if output.event is not None:
            self._known += 1
            self._publish_event(output, message.header.stamp)
        self._publish_status(output, message.header.stamp)
        self._pose_ns = now_ns
        if output.refused:
            self.health.report_event(f"pose_{output.refused}", _REFUSALS[output.refused])
        elif now_ns - stamp_ns > _LATE_NS:
            self.health.report_event(
                "mocap_late", "poses come more than 0.1 s after their capture"
            )

    def _publish_event(self, output: DetectorOutput, stamp: Any) -> None:
        event = output.event
        assert event is not None
        message = CollisionEvent()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.trigger = _TRIGGERS[event.trigger]
        message.contact_stamp = to_time(output.contact_ns)
        message.contact_position = point(event.x_c)
        message.flight_direction = vector(event.flight_direction)
        message.confidence, message.statistic = event.confidence, event.statistic
        message.count = event.count
        self._events.publish(message)

    def _publish_status(self, output: DetectorOutput, stamp: Any) -> None:
        message = DetectorStatus()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.statistic = output.statistic
        message.threshold = self.records["detector"].threshold
        message.poses, message.rejected = self._core.poses, self._core.rejected
        self._status.publish(message)

    def report(self, now_ns: int) -> None:
        """Add the counts."""
        self.health.value("poses", self._core.poses)
        self.health.value("collisions", self._known)
        for why, count in sorted(self._core.refused.items()):
            self.health.value(f"refused.{why}", count)
        super().report(now_ns)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(DetectorNode, argv))


if __name__ == "__main__":
    main()
