"""Parameters of a running node, set as `ros2 param set` does it."""

import time

from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter


def set_parameters(world, node, patience_s=60.0, **values):
    """Set parameters of a node (`a__b` is a.b); return whether and why not, of each."""
    sent = [Parameter(name.replace("__", "."), value=v) for name, v in values.items()]
    request = SetParameters.Request(parameters=[p.to_parameter_msg() for p in sent])
    client = world.node.create_client(SetParameters, f"/{node}/set_parameters")
    assert client.wait_for_service(patience_s), f"no parameter service of {node}"
    executor = SingleThreadedExecutor(context=world.node.context)
    executor.add_node(world.node)
    try:
        future = client.call_async(request)
        end = time.monotonic() + patience_s
        while not future.done():
            assert time.monotonic() < end, f"{node} does not answer"
            executor.spin_once(timeout_sec=0.1)
        return [(result.successful, result.reason) for result in future.result().results]
    finally:
        executor.remove_node(world.node)
        world.node.destroy_client(client)
