"""Looks at topics and parameters of the running nodes, as `ros2 topic` and `ros2 param` do.

    python -m tombo_flight.suite.graph_node '["param", "list", "mission"]' [--json]

It also asks them for one thing, as an operator does: `["call", "takeoff", NAMESPACE]`.

Exit code 0; 1 when a node refused a request or a value, or no message came; 2 for bad input.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Collection, Mapping
from itertools import pairwise
from typing import Any

import rclpy
import yaml
from rcl_interfaces.msg import Parameter
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from tombo_dynamics.errors import InputError, unknown_name
from tombo_flight.suite.parameter_yaml import parameter_yaml
from tombo_ros.operator_requests import OperatorRequests
from tombo_ros.topic import message_class

_PATIENCE_S = 20.0
"""Time that a node may take to be discovered, or to answer, on a busy machine."""
_MEET_S = 5.0
"""Time in which all nodes and topics have been discovered after the first, on a busy machine."""
_BRIDGE_S = 0.5
"""The same on an idle machine, where everything is listed."""
_LOOK_S = 0.02
_NAME = "graph"
_Show = Callable[[Any], None]


def _nodes(node: Node) -> list[str]:
    """Return the full names of the other nodes."""
    found = node.get_node_names_and_namespaces()
    return sorted(f"{space.rstrip('/')}/{name}" for name, space in found if name != _NAME)


def _topics(node: Node) -> dict[str, str]:
    """Return topic → type of those with a publisher."""
    found = node.get_topic_names_and_types()
    return {name: kinds[0] for name, kinds in sorted(found) if node.count_publishers(name)}


def _discovers(discovered: Callable[[], object]) -> bool:
    """Wait until something is discovered, then for the others; return whether it is there."""
    end_s = time.monotonic() + _PATIENCE_S
    while not discovered() and time.monotonic() < end_s:
        time.sleep(_LOOK_S)
    time.sleep(_BRIDGE_S)
    return bool(discovered())


def _await_name(kind: str, name: str, discovered: Callable[[], Collection[str]]) -> str:
    """Return the full name of a topic or node once it is discovered."""
    name = f"/{name.lstrip('/')}"
    end_s = time.monotonic() + _MEET_S
    while name not in (known := discovered()):
        if time.monotonic() > end_s:
            raise unknown_name(kind, name, known)
        time.sleep(_LOOK_S)
    return name


def _subscribe(node: Node, name: str, take: Callable[[Any], None]) -> None:
    """Hand each message of a topic to `take`, those of a latched one from the first on."""
    name = _await_name("topic", name, lambda: _topics(node))
    typename = _topics(node)[name]
    try:
        kind = message_class(typename)
    except ImportError as error:
        raise InputError(f"{name}: {typename} is not installed") from error
    offered = [info.qos_profile for info in node.get_publishers_info_by_topic(name)]
    latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
    latest = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(kind, name, take, kept if latched else latest)


def plain_message(message: Any) -> Any:
    """Return a message as nested plain values."""
    if hasattr(message, "get_fields_and_field_types"):
        names = message.get_fields_and_field_types()
        return {name: plain_message(getattr(message, name)) for name in names}
    if hasattr(message, "tolist"):
        return message.tolist()
    if isinstance(message, list | tuple | bytes):
        return [plain_message(each) for each in message]
    return message


def _topic(node: Node, show: _Show, verb: str, name: str, count: int, seconds: float) -> int:
    """List topics, print messages of one, or measure its rate."""
    if verb == "list":
        show(_topics(node))
        return 0
    times: list[float] = []

    def take(message: Any) -> None:
        times.append(time.monotonic())
        if verb == "echo":
            show(plain_message(message))

    _subscribe(node, name, take)
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and not (verb == "echo" and 0 < count <= len(times)):
        rclpy.spin_once(node, timeout_sec=0.1)
    if verb == "hz":
        gaps = [after - before for before, after in pairwise(times)]
        rate = len(gaps) / sum(gaps) if gaps else 0.0
        show({"messages": len(times), "rate_hz": round(rate, 2)})
    return 0 if times else 1


def _param(node: Node, show: _Show, verb: str, name: str, key: str = "", value: str = "") -> int:
    """List, print or set parameters of a node."""
    name = _await_name("node", name, lambda: _nodes(node))
    client = AsyncParameterClient(node, name)

    def answer(future: Any) -> Any:
        rclpy.spin_until_future_complete(node, future, timeout_sec=_PATIENCE_S)
        if not future.done() or future.result() is None:
            raise InputError(f"node {name} does not answer; accepted: a node that runs")
        return future.result()

    if not client.wait_for_services(_PATIENCE_S):
        raise InputError(f"node {name} has no parameters; accepted: another node")
    if verb == "set":
        parameter = Parameter(name=key, value=get_parameter_value(value))
        (result,) = answer(client.set_parameters([parameter])).results
        show({"set": bool(result.successful), "reason": result.reason})
        return 0 if result.successful else 1
    names = sorted(answer(client.list_parameters()).result.names)
    if key and key not in names:
        raise unknown_name(f"parameter of {name}", key, names)
    if verb == "list":
        show(names)
        return 0
    wanted = [key] if key else names
    found = map(parameter_value_to_python, answer(client.get_parameters(wanted)).values)
    values = {n: plain_message(v) for n, v in zip(wanted, found, strict=True)}
    if verb == "get":
        show(values[key])
    else:
        sys.stdout.write(parameter_yaml({name.lstrip("/"): values}))
    return 0


def _call(node: Node, show: _Show, request: str, *, as_json: bool) -> int:
    """Ask for takeoff, hold, land, abort or kill, wait for the answer, and print it."""
    requests = OperatorRequests(node)
    _discovers(lambda: requests.offered(request))  # without it, the answer says who is missing
    answers = requests.read(f"{request}\n")
    while not answers:
        answers = requests.answers()
        time.sleep(_LOOK_S)
    answer = answers[0]["answer"]
    words = f"{request}{'' if answer['success'] else ' refused'}: {answer['message']}"
    show(answer if as_json else words)
    return 0 if answer["success"] else 1


def main(arguments: list[str] | None = None) -> int:
    """Look or ask, and print."""
    request, *more = sys.argv[1:] if arguments is None else arguments
    group, verb, *words = json.loads(request)
    as_json, calls = "--json" in more, group == "call"

    def show(value: Any) -> None:
        if as_json:
            text = json.dumps(value)
        elif isinstance(value, Mapping):
            text = yaml.safe_dump(value, sort_keys=False) + ("---" if verb == "echo" else "")
        else:
            text = "\n".join(value) if isinstance(value, list) else str(value)
        sys.stdout.write(f"{text.rstrip()}\n")
        sys.stdout.flush()

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Python's own end the waiting
    namespace = words[0] if calls else None
    node = Node(_NAME, namespace=namespace, start_parameter_services=False)
    try:
        if calls:
            return _call(node, show, verb, as_json=as_json)
        if not _discovers(lambda: _nodes(node)):
            raise InputError("no node runs in this domain; accepted: while `tombo up` runs")
        return (_topic if group == "topic" else _param)(node, show, verb, *words)
    except InputError as error:
        sys.stderr.write(f"Error: {error}\n")
        return 2
    except (KeyboardInterrupt, ExternalShutdownException, BrokenPipeError):
        return int(calls)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
