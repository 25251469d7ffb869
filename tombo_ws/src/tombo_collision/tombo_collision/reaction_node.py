"""The reaction as a node, in line between mission and controller: one set point in, one out."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tombo_bag.topics import (
    COLLISION_EVENT,
    DETECTOR_STATUS,
    MARKERS,
    MISSION_SETPOINT,
    MOCAP_POSE,
    ODOMETRY,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_collision.detector import CollisionEvent
from tombo_collision.params import ReactionLimits, ReactionParams
from tombo_collision.reaction_core import (
    BLIND,
    DUPLICATE,
    HOLDING,
    ReactionCore,
    Setpoint,
    Status,
)
from tombo_msgs.msg import CollisionEvent as EventMessage
from tombo_msgs.msg import PositionSetpoint, ReactionStatus
from tombo_ros.conversion import array, point, to_ns, to_time, vector
from tombo_ros.health import ERROR
from tombo_ros.markers import GREEN, RED, point_marker
from tombo_ros.message_template import MessageTemplate
from tombo_ros.node_loop import LoopNode, run

_NOWHERE = (math.nan, math.nan, math.nan)
_TRIGGERS = {
    EventMessage.TRIGGER_REGION: "region",
    EventMessage.TRIGGER_INNOVATION: "innovation",
}
_HOLDS = {
    "detector_silent": "no word of the detector though poses come: holding",
    "mission_silent": "no set points of the mission: holding",
    "two_publishers": "two nodes publish what only one may: holding",
}
_EVENT_REFUSALS = {
    "not_finite": "a collision with NaN or infinity",
    "not_unit": "a collision whose flight direction is no unit vector",
    "stale": "a collision of long ago",
    "future": "a collision stamped in the future",
    "elsewhere": "a collision far from the vehicle",
    "not_flying": "a collision while not flying",
    "wrong_frame": "a collision whose frame is not map",
}


class ReactionNode(LoopNode):
    """Runs `ReactionCore` on what arrives."""

    def __init__(self) -> None:
        """Declare parameters and topics."""
        records = {"reaction": ReactionParams(), "inputs": ReactionLimits()}
        super().__init__("reaction", 200.0, records)
        self._reacts = self.declare(
            "react", True, "false: collisions are seen, and nothing is done about them"
        )
        self._core = ReactionCore(self.records["reaction"], self.records["inputs"])
        self._mission_setpoint_in = self.subscribe(MISSION_SETPOINT)
        self._event_in = self.subscribe(COLLISION_EVENT)
        self._detector_in = self.subscribe(DETECTOR_STATUS)
        self._odometry_in = self.subscribe(ODOMETRY)
        self._pose_in = self.subscribe(MOCAP_POSE)
        self._exclusive = (self._mission_setpoint_in, self._event_in, self._detector_in)
        self._odometry = MessageTemplate(
            ODOMETRY.typename,
            {"header": {"frame_id": "map"}, "child_frame_id": "base_link"},
        )
        self._position = self._odometry.field("pose.pose.position.x", 3)
        self._setpoint = self.advertise(SETPOINT)
        self._status = self.advertise(REACTION_STATUS)
        self._markers = self.advertise(MARKERS)
        self._published_status: Status | None = None
        self._refused = 0

    def on_parameters_changed(self, name: str) -> None:
        """Take new parameters in flight."""
        self._core.params = self.records["reaction"]
        self._core.limits = self.records["inputs"]

    def step(self, now_ns: int) -> None:
        """Take what has come, say what follows from it."""
        logic = self._core
        if self._pose_in.take_raw():
            logic.mocap(now_ns)
        if self._detector_in.take_raw():
            logic.detector(now_ns)
        self._take_odometry(now_ns)
        for taken in self._mission_setpoint_in.take():
            self._take_mission_setpoint(taken.message, now_ns)
        for taken in self._event_in.take():
            if self._reacts:
                self._take_event(taken.message, now_ns)
        wall_ns = time.time_ns()  # whatever the clock: arrivals are stamped by the system's
        logic.multiple_publishers(
            any(found.multiple_publishers(wall_ns) for found in self._exclusive)
        )
        setpoint = logic.tick(now_ns)
        if setpoint is not None:
            self._publish_setpoint(setpoint, now_ns)
        if logic.status is not self._published_status:
            self._publish_status(logic.status, now_ns)

    def _take_odometry(self, now_ns: int) -> None:
        samples = self._odometry_in.take_raw()
        if not samples:
            return
        data = samples[-1].message
        if not self._odometry.fits(data):
            self._refuse("odometry_shape", "odometry is not of base_link in map")
        elif not self._core.odometry(np.array(self._position.of(data)), now_ns):
            self._refuse("odometry_not_finite", "odometry with NaN or infinity")

    def _take_mission_setpoint(self, message: Any, now_ns: int) -> None:
        mission_setpoint = Setpoint(
            array(message.position),
            array(message.velocity),
            array(message.acceleration),
            float(message.yaw),
            int(message.phase),
        )
        if message.header.frame_id.lstrip("/") != "map":
            self._refuse("mission_wrong_frame", "a set point whose frame is not map")
        elif not self._core.mission(mission_setpoint, now_ns):
            text = "a set point with NaN, infinity or an unknown phase: the last one stands"
            self._refuse("mission_not_finite", text)

    def _take_event(self, message: Any, now_ns: int) -> None:
        stamp_ns = to_ns(message.header.stamp)
        event = CollisionEvent(
            1e-9 * stamp_ns,
            _TRIGGERS.get(message.trigger, "unknown"),
            1e-9 * to_ns(message.contact_stamp),
            array(message.contact_position),
            array(message.flight_direction),
            float(message.confidence),
            float(message.statistic),
            int(message.count),
        )
        if message.header.frame_id.lstrip("/") != "map":
            why = "wrong_frame"
        else:
            why = self._core.event(event, stamp_ns, now_ns)
        if why and why != DUPLICATE:
            self._refuse(f"event_{why}", _EVENT_REFUSALS[why])

    def _refuse(self, key: str, text: str) -> None:
        self._refused += 1
        self.health.report_event(key, text)

    def _publish_setpoint(self, setpoint: Setpoint, now_ns: int) -> None:
        message = PositionSetpoint()
        message.header.stamp, message.header.frame_id = to_time(now_ns), "map"
        message.position = point(setpoint.position)
        message.velocity = vector(setpoint.velocity)
        message.acceleration = vector(setpoint.acceleration)
        message.yaw, message.phase = setpoint.yaw, setpoint.phase
        self._setpoint.publish(message)

    def _publish_status(self, status: Status, now_ns: int) -> None:
        reaction = status.reaction
        decided = reaction.state != "idle"
        before = self._published_status
        self._published_status = status
        message = ReactionStatus()
        message.header.stamp, message.header.frame_id = to_time(now_ns), "map"
        message.state = status.state
        message.x_c = point(reaction.x_c if decided else _NOWHERE)
        message.x_r = point(reaction.x_r if decided else _NOWHERE)
        message.n_r = vector(reaction.n_r if decided else _NOWHERE)
        message.collisions = reaction.collisions
        self._status.publish(message)
        if decided and (before is None or before.reaction is not reaction):
            self._markers.publish(point_marker(now_ns, "x_c", reaction.x_c, RED))
            self._markers.publish(point_marker(now_ns, "x_r", reaction.x_r, GREEN))
        for why, text in _HOLDS.items():
            here = status.state == HOLDING and status.why == why
            self.health.fault(why, here, text, ERROR)
        blind = status.state == BLIND
        self.health.fault("blind", blind, "pose or estimate is too old", ERROR)

    def report(self, now_ns: int) -> None:
        """Add the counts."""
        self.health.value("collisions", self._core.status.reaction.collisions)
        self.health.value("refused", self._refused)
        super().report(now_ns)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(ReactionNode, argv))


if __name__ == "__main__":
    main()
