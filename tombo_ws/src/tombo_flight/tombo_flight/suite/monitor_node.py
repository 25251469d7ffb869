"""Prints the nodes' diagnostics and the state of the flight as JSON lines for the supervisor.

It also passes on what the operator asks for.

    python -m tombo_flight.suite.monitor_node [--flight [--mocap]] [--px4] [--vehicle=NAME]

`{"diagnostics": [status, ...]}` for each report on /diagnostics; with `--flight` also, 20 times a
second, `{"flight": {...}}`: the newest true pose with its stamp, and the mission's phase. With
`--mocap` it is the pose that the motion capture sees: the truth of a real vehicle is unknown.
With `--px4` also `{"px4": {...}}`: each change of `/px4/status`.

With `--vehicle=NAME`, which may be given many times, each vehicle's own topics and services are
meant, and each line says whose it is: `"vehicle"`.

A line on standard input, `hold`, `land` or `kill`, calls the services for it (std_srvs/Trigger,
`operator_requests`); `{"answer": {"request", "success", "message"}}` says what came of it.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from tombo_bag.topics import (
    DIAGNOSTICS,
    MISSION_STATUS,
    MOCAP_POSE,
    PX4_STATUS,
    TRUE_ODOMETRY,
    TopicSpec,
)
from tombo_flight.suite.node_diagnostics import plain_status
from tombo_ros.conversion import to_ns
from tombo_ros.operator_requests import OperatorRequests
from tombo_ros.topic import PolledSubscription

_PERIOD_S = 0.05
_VEHICLE = "--vehicle="
_EVERY_NODE = 100
"""Reports of all nodes may come at once."""


def _typed() -> str:
    """Return the lines of standard input; nothing where it is closed."""
    ready, _, _ = select.select([0], [], [], 0.0)
    return os.read(0, 4096).decode("utf-8", "replace") if ready else ""


class Monitor:
    """Polls its topics: at 20 Hz it has time, and costs the nodes nothing."""

    def __init__(self, node: Node, known: TopicSpec | None, *, px4: bool) -> None:
        self._diagnostics = PolledSubscription(node, DIAGNOSTICS, _EVERY_NODE)
        self._known = None if known is None else PolledSubscription(node, known, 1)
        self._mission = None if known is None else PolledSubscription(node, MISSION_STATUS)
        self._px4 = PolledSubscription(node, PX4_STATUS) if px4 else None
        self._phase: int | None = None
        self._requests = OperatorRequests(node)

    def lines(self, typed: str) -> list[dict[str, Any]]:
        """Send the typed requests; return the messages since the last call, and answers."""
        refused = self._requests.read(typed)
        return [*self.changes(), *refused, *self._requests.answers()]

    def changes(self) -> list[dict[str, Any]]:
        """Return the messages since the last call."""
        found: list[dict[str, Any]] = [
            {"diagnostics": [plain_status(status) for status in taken.message.status]}
            for taken in self._diagnostics.take()
        ]
        if self._px4 is not None:
            found += [{"px4": _px4(taken.message)} for taken in self._px4.take()]
        if self._known is not None and self._mission is not None:
            for taken in self._mission.take():
                self._phase = int(taken.message.phase)
            known = self._known.take()
            if known:
                found.append({"flight": self._flight(known[-1].message)})
        return found

    def _flight(self, known: Any) -> dict[str, Any]:
        pose = getattr(known.pose, "pose", known.pose)
        x, y = pose.orientation.x, pose.orientation.y
        return {
            "stamp_ns": to_ns(known.header.stamp),
            "height_m": pose.position.z,
            "upright": 1.0 - 2.0 * (x * x + y * y),
            "phase": self._phase,
        }


def _px4(status: Any) -> dict[str, Any]:
    names = ("connected", "armed", "mode", "stage", "why", "status_text")
    return {**{name: getattr(status, name) for name in names}, "findings": list(status.findings)}


def _known(words: Sequence[str]) -> TopicSpec | None:
    """Return the topic that tells where the vehicle is, if that is wanted."""
    if "--flight" not in words:
        return None
    return MOCAP_POSE if "--mocap" in words else TRUE_ODOMETRY


def main(argv: Sequence[str] | None = None) -> None:
    """Print until a signal comes, or until nobody reads any more."""
    arguments = sys.argv if argv is None else list(argv)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, frame: stopped.append(caught))
    rclpy.init(args=arguments, signal_handler_options=rclpy.SignalHandlerOptions.NO)
    words = remove_ros_args(arguments)
    vehicles = [word.removeprefix(_VEHICLE) for word in words if word.startswith(_VEHICLE)]
    nodes = {
        name: Node("monitor", namespace=name or None, start_parameter_services=False)
        for name in ["", *vehicles]
    }
    monitors = {
        name: Monitor(node, None if vehicles and not name else _known(words), px4="--px4" in words)
        for name, node in nodes.items()
    }
    try:
        while not stopped:
            typed = _typed()
            for name, monitor in monitors.items():
                vehicle = {"vehicle": name} if name else {}
                for line in monitor.lines(typed if name or not vehicles else ""):
                    sys.stdout.write(json.dumps(vehicle | line) + "\n")
            sys.stdout.flush()
            time.sleep(_PERIOD_S)
    except BrokenPipeError:
        sys.stderr.close()
    finally:
        for node in nodes.values():
            node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
