"""The live page of a running suite, or of a lab's own nodes.

python -m tombo_web.live_node '{"host": …, "port": …, "foxglove": …, "names": {…}}'
"""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Any, Final

import rclpy
from rclpy.serialization import deserialize_message

from tombo_bag.message_codec import FORMS, MessageCodec
from tombo_bag.topics import (
    DIAGNOSTICS,
    MARKERS,
    MISSION_STATUS,
    MOCAP_POSE,
    POSE_TYPES,
    TF,
    TOPICS,
    TopicSpec,
)
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.time_base import SECOND_NS
from tombo_ros.operator_requests import OperatorRequests
from tombo_ros.topic import PolledSubscription, message_class
from tombo_web.live_view import TopicMessage
from tombo_web.server import Address, serve_live

_FAST_HZ: Final = 60.0
"""Of a faster topic the newest message is enough."""
_DEPTH: Final = 100
_NOT_READ: Final = (TF.name, "/clock")
_FIND_S: Final = 5.0
"""How long a lab's topic is waited for."""
_VEHICLES_S: Final = 1.0
"""How long the poses of vehicles are looked for."""
_OF_VEHICLE: Final = re.compile(r"/v\d+/mocap/pose")
"""Poses of one of several vehicles."""
Reader = Callable[[bytes], Mapping[str, Any]]
"""Bytes of a message → its fields by name."""


class LiveTopics:
    """Polls the topics; no callback, no executor, so it costs the nodes nothing."""

    seekable = False

    def __init__(self, names: Mapping[str, str]) -> None:
        """Subscribe to the suite's topics.

        Args:
            names: topic of the lab → topic of the suite.

        Raises:
            InputError: a name is unknown, or nothing publishes the lab's topic.
        """
        for theirs, name in names.items():
            if name not in TOPICS:
                raise unknown_name(f"topic for '{theirs}'", name, TOPICS)
        rclpy.init()
        self._node = rclpy.create_node("tombo_live")
        self._nodes = [
            rclpy.create_node("tombo_live", namespace=name) for name in self._vehicles(set(names))
        ]
        self.vehicles: dict[str, dict[str, Any]] = {}
        """Newest position [m, map] and phase of each of several vehicles."""
        if self._nodes:  # the page's scene and curves are of the first
            self._node.destroy_node()
            self._node = self._nodes[0]
        else:
            self._nodes = [self._node]
        self._began_ns = time.time_ns()
        self.obstacle: dict[str, float] | None = None
        self._taken: list[tuple[str, PolledSubscription, Reader]] = []
        replaced = set(names.values())
        for spec in TOPICS.values():
            if spec.name not in replaced and spec.name not in _NOT_READ:
                self._subscribe(spec.name, spec)
        for theirs, name in names.items():
            self._subscribe(name, replace(TOPICS[name], name=theirs, typename=self._type(theirs)))
        self._others = [
            (
                node.get_namespace().strip("/"),
                PolledSubscription(node, spec, 1),
                _reader(spec.typename),
            )
            for node in self._nodes
            for spec in (MOCAP_POSE, MISSION_STATUS)
            if len(self._nodes) > 1
        ]
        self._requests = [OperatorRequests(node) for node in self._nodes]
        self._answers: list[dict[str, Any]] = []

    @property
    def now_s(self) -> float:
        """Time since the page's start [s]."""
        return (time.time_ns() - self._began_ns) / SECOND_NS

    def begin(self) -> list[TopicMessage]:
        """Return nothing: latched messages arrive by themselves."""
        return []

    def advance(self, elapsed_s: float) -> list[TopicMessage]:
        """Return the messages since the last call, in order of arrival."""
        self._look_at_vehicles()
        messages = []
        for name, subscription, read in self._taken:
            for data, received_ns in subscription.take_raw():
                try:
                    fields = read(data)
                except (InputError, ValueError):  # another frame or version: the node says so
                    continue
                arrival_s = (received_ns - self._began_ns) / SECOND_NS
                stamp_ns = fields.get("stamp_ns", received_ns)
                time_s = (int(stamp_ns) - self._began_ns) / SECOND_NS
                messages.append(TopicMessage(name, fields, time_s, arrival_s))
                self.obstacle = fields.get("obstacle", self.obstacle)
        return sorted(messages, key=lambda message: message.arrival_s)

    def request(self, name: str) -> None:
        """Call the operator's services for hold, land or kill, of each vehicle."""
        for requests in self._requests:
            self._answers += requests.read(f"{name}\n")

    def answers(self) -> list[dict[str, Any]]:
        """Return the answers of the nodes since the last call."""
        come = [answer for requests in self._requests for answer in requests.answers()]
        answers, self._answers = [*self._answers, *come], []
        return [{"kind": "answer", **answer["answer"]} for answer in answers]

    def close(self) -> None:
        """Leave the graph."""
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown()

    def _vehicles(self, given: set[str]) -> list[str]:
        """Return the namespaces of several vehicles (v1, v2) on the graph; empty: there is one."""
        names: set[str] = set()
        end_s = time.monotonic() + (0.0 if given else _VEHICLES_S)
        while time.monotonic() < end_s and MOCAP_POSE.name not in names:
            names = {name for name, _ in self._node.get_topic_names_and_types()}
            time.sleep(0.05)
        several = [name.split("/")[1] for name in names if _OF_VEHICLE.fullmatch(name)]
        return sorted(several, key=lambda name: int(name[1:]))

    def _look_at_vehicles(self) -> None:
        for name, subscription, read in self._others:
            for data, _ in subscription.take_raw():
                fields = read(data)
                known = self.vehicles.setdefault(name, {"name": name, "position": None})
                if "phase" in fields:
                    known["phase"] = str(fields["text"])
                else:
                    known["position"] = [round(float(x), 4) for x in fields["position"]]

    def _subscribe(self, name: str, spec: TopicSpec) -> None:
        depth = 1 if spec.rate_hz > _FAST_HZ else _DEPTH
        subscription = PolledSubscription(self._node, spec, depth)
        self._taken.append((name, subscription, _reader(spec.typename)))

    def _type(self, topic: str) -> str:
        """Return the type of a topic of the graph.

        Raises:
            InputError: nothing publishes it.
        """
        end_s = time.monotonic() + _FIND_S
        while time.monotonic() < end_s:
            for name, types in self._node.get_topic_names_and_types():
                if name == topic:
                    return str(types[0])
            time.sleep(0.05)
        raise InputError(f"--map '{topic}': nothing publishes it; accepted: a topic of the graph")


def _reader(typename: str) -> Reader:
    """Return what reads the bytes of a message as fields by name."""
    if typename in FORMS:
        codec = MessageCodec(typename)
        return lambda data: vars(codec.decode(data))
    kind = message_class(typename)
    if typename == DIAGNOSTICS.typename:
        return lambda data: {"nodes": _nodes(deserialize_message(data, kind))}
    if typename == MARKERS.typename:
        return lambda data: _obstacle(deserialize_message(data, kind))
    if typename in POSE_TYPES:
        return lambda data: _pose(deserialize_message(data, kind), *POSE_TYPES[typename])
    return lambda data: _numbers(deserialize_message(data, kind))


def _nodes(message: Any) -> list[tuple[str, int, str]]:
    levels = ((s.name, s.level, s.message) for s in message.status)
    return [(n, v[0] if isinstance(v, bytes) else int(v), text) for n, v, text in levels]


def _obstacle(message: Any) -> dict[str, Any]:
    for marker in message.markers:
        if marker.ns == "obstacle":
            at, scale = marker.pose.position, marker.scale
            return {
                "obstacle": {"x_m": at.x, "y_m": at.y, "radius_m": scale.x / 2, "top_m": scale.z}
            }
    return {}


def _pose(message: Any, position: str, attitude: str) -> dict[str, Any]:
    p, q = attrgetter(position, attitude)(message)
    stamp = message.header.stamp
    return {
        "stamp_ns": stamp.sec * SECOND_NS + stamp.nanosec,
        "position": (p.x, p.y, p.z),
        "attitude": (q.x, q.y, q.z, q.w),
    }


def _numbers(message: Any) -> dict[str, Any]:
    names = message.get_fields_and_field_types()
    return {n: v for n in names if isinstance(v := getattr(message, n), int | float)}


def main() -> None:
    """Serve the page; a bad argument is said in a line, exit code 2."""
    given = json.loads(sys.argv[1])
    names = given.pop("names")
    try:
        suite = LiveTopics(names)
        try:
            serve_live(suite, "Running suite", Address(**given))
        finally:
            suite.close()
    except InputError as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
