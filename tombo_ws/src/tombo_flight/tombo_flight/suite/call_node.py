"""Asks the running nodes for one thing, as an operator does, and prints what they answer.

    python -m tombo_flight.suite.call_node takeoff|hold|land|abort|kill NAMESPACE [--json]

Exit code 0 when it was obeyed, 1 when it was refused, 2 when no node offers it.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence

import rclpy
from rclpy.node import Node

from tombo_ros.operator_requests import OperatorRequests

_DISCOVERY_S = 20.0
"""So long a node may take to be discovered, on a busy machine."""
_BRIDGE_S = 0.5
"""Time in which all nodes have been discovered after the first [s]."""
_LOOK_S = 0.02


def main(argv: Sequence[str] | None = None) -> int:
    """Ask, wait for the answer, print it."""
    request, namespace, *more = (sys.argv if argv is None else list(argv))[1:]
    rclpy.init()
    node = Node("operator", namespace=namespace, start_parameter_services=False)
    try:
        requests = OperatorRequests(node)
        end_s = time.monotonic() + _DISCOVERY_S
        while not requests.offered(request) and time.monotonic() < end_s:
            time.sleep(_LOOK_S)
        time.sleep(_BRIDGE_S)
        answers = requests.read(f"{request}\n")
        while not answers:
            answers = requests.answers()
            time.sleep(_LOOK_S)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    answer = answers[0]["answer"]
    words = f"{request}{'' if answer['success'] else ' refused'}: {answer['message']}"
    sys.stdout.write(f"{json.dumps(answer) if '--json' in more else words}\n")
    return 0 if answer["success"] else 1


if __name__ == "__main__":
    sys.exit(main())
