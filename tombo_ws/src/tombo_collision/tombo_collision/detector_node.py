"""The detector as a node: mocap poses in, collisions out, and what it made of each pose."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

from tombo_bag.topics import COLLISION_EVENT, DETECTOR_STATUS, MOCAP_POSE
from tombo_collision.params import DetectorParams
from tombo_collision.watch import TWO_PUBLISHERS, CollisionWatch, Seen
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
    """Runs `CollisionWatch` on each pose."""

    def __init__(self) -> None:
        """Declare parameters and topics."""
        super().__init__("detector", 200.0, {"detector": DetectorParams()})
        self._watch = CollisionWatch(self.records["detector"])
        self._poses = self.listen(MOCAP_POSE, depth=20)
        self._events = self.speak(COLLISION_EVENT)
        self._status = self.speak(DETECTOR_STATUS)
        self._pose_ns: int | None = None
        self._known = 0

    def records_changed(self, name: str) -> None:
        """Take new parameters in flight."""
        self._watch.retune(self.records["detector"])

    def step(self, now_ns: int) -> None:
        """Take poses."""
        # arrivals are stamped by the system's clock, whatever the node's
        crowded = self._poses.crowded(time.time_ns())
        for taken in self._poses.take():
            self._take(taken.message, now_ns, crowded)
        silent = self._pose_ns is not None and now_ns - self._pose_ns > _SILENT_NS
        self.health.fault("mocap_silent", silent, "no mocap poses: no collision can be seen")

    def _take(self, message: Any, now_ns: int, crowded: bool) -> None:
        stamp_ns = to_ns(message.header.stamp)
        if crowded:
            seen = self._watch.refuse(TWO_PUBLISHERS)
        else:
            seen = self._watch.pose(
                stamp_ns,
                now_ns + self.slack_ns,
                message.header.frame_id,
                array(message.pose.position),
                array(message.pose.orientation),
            )
        if seen.event is not None:
            self._known += 1
            self._publish_event(seen, message.header.stamp)
        self._publish_status(seen, message.header.stamp)
        self._pose_ns = now_ns
        if seen.refused:
            self.health.happened(f"pose_{seen.refused}", _REFUSALS[seen.refused])
        elif now_ns - stamp_ns > _LATE_NS:
            self.health.happened("mocap_late", "poses come more than 0.1 s after their capture")

    def _publish_event(self, seen: Seen, stamp: Any) -> None:
        event = seen.event
        assert event is not None
        message = CollisionEvent()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.trigger = _TRIGGERS[event.trigger]
        message.contact_stamp = to_time(seen.contact_ns)
        message.contact_position = point(event.x_c)
        message.flight_direction = vector(event.flight_direction)
        message.confidence, message.statistic = event.confidence, event.statistic
        message.count = event.count
        self._events.publish(message)

    def _publish_status(self, seen: Seen, stamp: Any) -> None:
        message = DetectorStatus()
        message.header.stamp, message.header.frame_id = stamp, "map"
        message.statistic = seen.statistic
        message.threshold = self.records["detector"].threshold
        message.poses, message.rejected = self._watch.poses, self._watch.rejected
        self._status.publish(message)

    def report(self, now_ns: int) -> None:
        """Add the counts."""
        self.health.value("poses", self._watch.poses)
        self.health.value("collisions", self._known)
        for why, count in sorted(self._watch.refused.items()):
            self.health.value(f"refused.{why}", count)
        super().report(now_ns)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(DetectorNode, argv))


if __name__ == "__main__":
    main()
