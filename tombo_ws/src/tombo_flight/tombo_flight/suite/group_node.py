"""Hosts several nodes of the suite in one process, each in the namespace of its vehicle.

    python -m tombo_flight.suite.group_node v1/estimator v1/controller ... [--ros-args ...]

Their loops share a thread, so they take no core from each other. Simulators include the
downwash of the group's other vehicles.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from tombo_flight.suite.nodes import HOST, SUITE
from tombo_flight.wiring import CORES
from tombo_ros.core_node import CoreNode
from tombo_ros.node_loop import NAMESPACE, LoopNode, run
from tombo_sim.sim_node import SimNode


def make_node(name: str) -> LoopNode:
    """Return the node of a name, as v1/estimator."""
    vehicle, _, node = name.rpartition("/")
    token = NAMESPACE.set(f"/{vehicle}" if vehicle else "")
    try:
        if SUITE[node] == HOST:
            return CoreNode(next(core for core in CORES if core.name == node))
        made: LoopNode = import_module(SUITE[node]).main.make()
        return made
    finally:
        NAMESPACE.reset(token)


def make_group(names: Sequence[str]) -> list[LoopNode]:
    """Return the nodes of some names."""
    nodes = [make_node(name) for name in names]
    simulators = [node for node in nodes if isinstance(node, SimNode)]
    for simulator in simulators:
        simulator.others = [other for other in simulators if other is not simulator]
    return nodes


def main(argv: Sequence[str] | None = None) -> None:
    """Run the nodes."""
    words = (sys.argv if argv is None else list(argv))[1:]
    names = words[: words.index("--ros-args")] if "--ros-args" in words else words
    sys.exit(run(lambda: make_group(names), argv))


if __name__ == "__main__":
    main()
