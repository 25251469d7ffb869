"""The mission as a node: flies its plan on the estimate, and follows the reaction's decisions."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tombo_bag.topics import (
    MISSION_SETPOINT,
    MISSION_STATUS,
    ODOMETRY,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_control.autopilot import IDLE, PHASE_NAMES
from tombo_control.estimate import Setpoint
from tombo_control.mission import MissionParams
from tombo_control.mission_core import MissionCore, MissionLimits
from tombo_dynamics.rotation import rotate_vectors
from tombo_msgs.msg import MissionStatus, PositionSetpoint
from tombo_ros.conversion import array, point, to_ns, to_time, vector
from tombo_ros.message_template import MessageTemplate
from tombo_ros.node_loop import LoopNode, run

_WAITS = {
    "estimate_silent": "no estimates: the plan stands still",
    "two_estimators": "two nodes publish odometry: the plan stands still",
    "reaction_holds": "the reaction holds: the plan waits",
    "blind": "the reaction sees stale poses: the plan waits",
    "reaction_silent": "no word of the reaction: the plan waits",
}


class MissionNode(LoopNode):
    """Runs `MissionCore` at 50 Hz."""

    runs_on_message = False

    def __init__(self) -> None:
        """Declare parameters and topics."""
        records = {"mission": MissionParams(), "inputs": MissionLimits()}
        super().__init__("mission", 50.0, records)
        started = self.declare(
            "auto_start",
            True,
            "false: wait on the ground until it is set to true",
            read_only=False,
        )
        self._core = MissionCore(self.records["mission"], self.records["inputs"], started)
        rotate_vectors(np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3))  # loads its compiled code now
        self._odometry_in = self.subscribe(ODOMETRY, depth=20)
        self._reaction_in = self.subscribe(REACTION_STATUS)
        self._answer_in = self.subscribe(SETPOINT)
        self._odometry = MessageTemplate(
            ODOMETRY.typename,
            {"header": {"frame_id": "map"}, "child_frame_id": "base_link"},
        )
        self._pose = self._odometry.field("pose.pose.position.x", 7)
        self._twist = self._odometry.field("twist.twist.linear.x", 3)
        self._setpoint = self.advertise(MISSION_SETPOINT)
        self._status = self.advertise(MISSION_STATUS)
        self._published_state: tuple[int, str] | None = None

    def on_parameters_changed(self, name: str) -> None:
        """Take a changed plan in flight, or the word to start."""
        self._core.params = self.records["mission"]
        self._core.limits = self.records["inputs"]
        self._core.started = self.parameters.get("auto_start")

    def step(self, now_ns: int) -> None:
        """Take what has come, go on with the plan."""
        course = self._core
        self._take_odometry(now_ns)
        # arrivals are stamped by the system's clock, whatever the node's
        course.multiple_publishers(self._odometry_in.multiple_publishers(time.time_ns()))
        for taken in self._reaction_in.take():
            message = taken.message
            course.reaction(
                int(message.state),
                array(message.x_r),
                int(message.collisions),
                to_ns(message.header.stamp),
                now_ns,
            )
        if self._answer_in.take_raw():
            course.reaction_alive(now_ns)
        setpoint = course.tick(now_ns)
        if setpoint is not None:
            self._publish(setpoint, now_ns)
        for why, text in _WAITS.items():
            wait_reason = course.wait_reason == why and course.mode != IDLE
            self.health.fault(why, wait_reason, text)

    def _take_odometry(self, now_ns: int) -> None:
        samples = self._odometry_in.take_raw()
        if not samples:
            return
        data = samples[-1].message
        if not self._odometry.fits(data):
            self.health.report_event("odometry_shape", "odometry is not of base_link in map")
            return
        pose, twist = np.array(self._pose.of(data)), np.array(self._twist.of(data))
        if not np.isfinite(pose).all() or not self._core.estimate(
            pose[:3], rotate_vectors(pose[3:], twist), now_ns
        ):
            self.health.report_event("odometry_not_finite", "odometry with NaN or infinity")

    def _publish(self, setpoint: Setpoint, now_ns: int) -> None:
        message: Any = PositionSetpoint()
        message.header.stamp, message.header.frame_id = to_time(now_ns), "map"
        message.position = point(setpoint.position)
        message.velocity = vector(setpoint.velocity)
        message.acceleration = vector(setpoint.acceleration)
        message.yaw, message.phase = setpoint.yaw, setpoint.phase
        self._setpoint.publish(message)
        state = (setpoint.phase, self._core.wait_reason)
        if state == self._published_state:
            return
        self._published_state = state
        status: Any = MissionStatus()
        status.header.stamp, status.header.frame_id = to_time(now_ns), "map"
        status.phase = setpoint.phase
        status.text = PHASE_NAMES[setpoint.phase].replace("_", " ")
        if self._core.wait_reason:
            status.text += f", waits: {_WAITS[self._core.wait_reason]}"
        self._status.publish(status)

    def report(self, now_ns: int) -> None:
        """Add where the plan stands."""
        self.health.value("phase", PHASE_NAMES[self._core.mode])
        self.health.value("flight_time_s", round(self._core.time_s, 2))
        super().report(now_ns)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the node."""
    sys.exit(run(MissionNode, argv))


if __name__ == "__main__":
    main()
