"""Prints poses of a topic as JSON lines, for a while: [arrival, stamp, x, y, z, qx, qy, qz, qw].

    python -m tombo_mocap.pose_listener_node SECONDS

Times are in ns of the system clock. It listens to `/mocap/pose`, whoever publishes it.
"""

from __future__ import annotations

import json
import sys
import time

import rclpy
from rclpy.node import Node

from tombo_bag.topics import MOCAP_POSE
from tombo_mocap.sources import bodies_of_message
from tombo_ros.conversion import to_ns
from tombo_ros.topic import PolledSubscription

_LOOK_S = 0.02
_DISCOVERY_S = 10.0
"""Time that a publisher may take to be discovered, on a busy machine."""


def main(arguments: list[str]) -> int:
    """Listen from the first pose on; return the exit code."""
    rclpy.init()
    node = Node("pose_listener", start_parameter_services=False)
    try:
        source = PolledSubscription(node, MOCAP_POSE, 1000)
        bodies = bodies_of_message(MOCAP_POSE.typename, to_ns)
        end_s = time.monotonic() + _DISCOVERY_S
        while not source.waiting() and time.monotonic() < end_s:
            time.sleep(_LOOK_S)
        if source.waiting():
            sys.stderr.write("poses come: carry the vehicle about now\n")
            sys.stderr.flush()
        end_s = time.monotonic() + float(arguments[0])
        while time.monotonic() < end_s:
            for taken in source.take():
                (body,) = bodies(taken.message)
                line = [taken.received_ns, body.stamp_ns, *body.position, *body.attitude]
                sys.stdout.write(f"{json.dumps(line)}\n")
            time.sleep(_LOOK_S)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
