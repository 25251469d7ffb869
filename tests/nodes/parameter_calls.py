"""Parameters of a running node, set as `ros2 param set` does it; and an operator's commands."""

import math
import time

from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from tombo_ros.core_node import LOOP_SILENT

RESEND_S = 10.0
"""How long an answer may take."""


def set_parameters(world, node, patience_s=60.0, **values):
    """Set parameters of a node (`a__b` is a.b); return whether and why not, of each."""
    sent = [Parameter(name.replace("__", "."), value=v) for name, v in values.items()]
    request = SetParameters.Request(parameters=[p.to_parameter_msg() for p in sent])
    answer = call(world, SetParameters, f"/{node}/set_parameters", request, patience_s)
    return [(result.successful, result.reason) for result in answer.results]


def call_trigger(world, node, name, patience_s=60.0):
    """Give a node a command; return whether it is obeyed, and why not.

    A loop that a busy machine has held up withdraws the command, which is given again then.
    """
    end = time.monotonic() + patience_s
    while True:
        answer = call(world, Trigger, f"/{node}/{name}", Trigger.Request(), patience_s)
        if answer.message != LOOP_SILENT or time.monotonic() > end:
            return answer.success, answer.message


def call(world, kind, service, request, patience_s):
    """Return the answer of a service.

    A server drops an answer whose reader it has not met within 100 ms, which a busy machine takes
    longer for: the request is sent again then, and may be obeyed twice.
    """
    client = world.node.create_client(kind, service)
    assert client.wait_for_service(patience_s), f"no service {service}"
    executor = SingleThreadedExecutor(context=world.node.context)
    executor.add_node(world.node)
    requests, sent = [], -math.inf
    end = time.monotonic() + patience_s
    try:
        while not any(future.done() for future in requests):
            now = time.monotonic()
            assert now < end, f"{service} does not answer"
            if now > sent + RESEND_S:
                requests.append(client.call_async(request))
                sent = now
            executor.spin_once(timeout_sec=0.1)
        return next(future.result() for future in requests if future.done())
    finally:
        executor.remove_node(world.node)
        world.node.destroy_client(client)
