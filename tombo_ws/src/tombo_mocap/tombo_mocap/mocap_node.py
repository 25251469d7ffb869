"""Motion capture as a node: `/mocap/pose` of the vehicle's rigid body, from any system."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

from tombo_bag.qos import SENSOR
from tombo_bag.topics import MOCAP_POSE, TopicSpec
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_mocap.params import ROS, MocapParams
from tombo_mocap.sources import FrameSource, LibraryFrames, bodies_of_message
from tombo_mocap.tracked_poses import TrackedBody, TrackedPoses
from tombo_ros.conversion import to_ns
from tombo_ros.core_node import main_of
from tombo_ros.health import ERROR
from tombo_ros.node_loop import LoopNode
from tombo_ros.pacing import ESTIMATOR
from tombo_ros.topic import PolledSubscription, TopicPublisher

_RATE_HZ = 1000.0
"""The node looks for frames this often, so that poses are passed on within 1 ms."""
_SILENT_NS = SECOND_NS // 5
"""Silence that is a fault: poses come at 30 Hz at least, so six are missing."""
_LOOK_NS = SECOND_NS // 2
"""How often a topic is looked for whose type is not known yet."""


class TopicFrames:
    """Frames of a driver's ROS topic, once somebody publishes it: its type is known then."""

    def __init__(self, node: LoopNode, params: MocapParams) -> None:
        self.fault = ""
        """Reason for a lack of frames; "": not known."""
        self._node, self._params = node, params
        self._subscription: PolledSubscription | None = None
        self._bodies: Any = None
        self._looked_ns = 0

    def frames(self) -> list[list[TrackedBody]]:
        """Return the rigid bodies of each frame received since the last call; never wait."""
        if self._subscription is None:
            self._find_topic(time.monotonic_ns())
            return []
        return [self._bodies(taken.message) for taken in self._subscription.take()]

    def _find_topic(self, now_ns: int) -> None:
        """Subscribe to the topic if it is published; look twice a second at most."""
        if now_ns - self._looked_ns < _LOOK_NS:
            return
        self._looked_ns = now_ns
        topic = "/" + self._params.topic.lstrip("/")
        types = dict(self._node.ros.get_topic_names_and_types()).get(topic, [])
        if not types:
            self.fault = f"nobody publishes {topic}"
            return
        try:
            self._bodies = bodies_of_message(types[0], to_ns)
            spec = TopicSpec(topic, types[0], SENSOR, 0.0, "poses of a driver")
            self._subscription = self._node.subscribe(spec)
        except (InputError, ImportError) as error:
            self.fault = str(error)
            return
        self.fault = ""

    def close(self) -> None:
        """Do nothing: the node closes the subscription."""


@dataclass
class _Vehicle:
    """A vehicle whose rigid body is tracked."""

    poses: TrackedPoses
    """Turns bodies of the system's world into poses of base_link in map."""
    output: TopicPublisher
    pose_ns: int = 0
    """Arrival of its newest pose, monotonic clock; 0: none yet."""


def _topic(namespace: str) -> TopicSpec:
    """Return the topic of a vehicle's poses; that of several vehicles is absolute."""
    name = MOCAP_POSE.name
    return replace(MOCAP_POSE, name=f"/{namespace}{name}" if namespace else name)


class MocapNode(LoopNode):
    """Passes on the poses of a system within 1 ms of their arrival."""

    def __init__(self) -> None:
        """Declare parameters, and connect.

        Raises:
            InputError: a parameter is refused.
        """
        records = {"mocap": MocapParams()}
        super().__init__("mocap", _RATE_HZ, records, fixed=records, priority=ESTIMATOR)
        try:
            if self.sim_time:
                raise InputError("use_sim_time: true; accepted: false, cameras see real time")
            self._params: MocapParams = self.records["mocap"]
            self._params.check()
            self._source: FrameSource = (
                TopicFrames(self, self._params)
                if self._params.system == ROS
                else LibraryFrames(self._params)
            )
        except InputError:
            self.destroy()
            raise
        self._vehicles = [
            _Vehicle(TrackedPoses(replace(self._params, body=body)), self.advertise(_topic(space)))
            for space, body in self._params.tracked.items()
        ]
        self._began_ns = time.monotonic_ns()
        self._frame_ns = 0

    def step(self, now_ns: int) -> None:
        """Publish the poses of all frames received since the last step."""
        for bodies in self._source.frames():
            self._frame_ns = time.monotonic_ns()
            for vehicle in self._vehicles:
                for pose in vehicle.poses.poses(bodies):
                    vehicle.output.send(pose)
                    vehicle.pose_ns = self._frame_ns

    def periodic_tasks(self, wall_ns: int, now_ns: int) -> None:
        """Report silence of the system, or else the loss of any vehicle's body.

        Texts are made only while there is a fault: this runs at 1 kHz.
        """
        mono_ns = time.monotonic_ns()
        silent = mono_ns - max(self._frame_ns, self._began_ns) > _SILENT_NS
        oldest_ns = min(vehicle.pose_ns for vehicle in self._vehicles)
        lost = not silent and mono_ns - max(oldest_ns, self._began_ns) > _SILENT_NS
        self.health.fault("no_frames", silent, self._silence() if silent else "", ERROR)
        self.health.fault("body_lost", lost, self._loss() if lost else "", ERROR)
        super().periodic_tasks(wall_ns, now_ns)

    def _silence(self) -> str:
        """Return the text of the fault `no_frames`."""
        params, why = self._params, self._source.fault
        source = params.topic if params.system == ROS else f"{params.system} {params.host}".strip()
        return f"nothing from {source}{f': {why}' if why else ''}"

    def _loss(self) -> str:
        """Return the text of the fault `body_lost`, about the body that was lost first."""
        vehicle = min(self._vehicles, key=attrgetter("pose_ns"))
        wanted = f"'{vehicle.poses.body}'" if vehicle.poses.body else "exactly one rigid body"
        return f"{wanted} is not seen; seen: {', '.join(sorted(vehicle.poses.names)) or 'none'}"

    def report(self, now_ns: int) -> None:
        """Add the counters of poses."""
        for vehicle in self._vehicles:
            prefix = f"{vehicle.poses.body}." if self._params.bodies else ""
            for key, count in vars(vehicle.poses.counters).items():
                self.health.value(f"poses.{prefix}{key}", count)
        super().report(now_ns)

    def close(self) -> None:
        """End the library's process."""
        self._source.close()


main = main_of(MocapNode)


if __name__ == "__main__":
    main()
