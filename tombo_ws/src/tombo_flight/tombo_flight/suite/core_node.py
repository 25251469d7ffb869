"""Hosts any core of the wiring that has no node of its own.

ros2 run tombo_bringup core_node --ros-args -p core:=NAME
"""

from __future__ import annotations

import sys

from tombo_dynamics.core import Core
from tombo_dynamics.errors import InputError, unknown_name
from tombo_flight import wiring
from tombo_ros.core_node import CoreNode, main_of

_PARAMETER = "core:="


def chosen(words: list[str]) -> type[Core]:
    """Return the core that a command line names.

    Raises:
        InputError: none, or one that is not in the wiring.
    """
    cores = {core.name: core for core in wiring.CORES}
    names = [word.removeprefix(_PARAMETER) for word in words if word.startswith(_PARAMETER)]
    if not names:
        raise InputError(f"parameter core is missing; accepted: {', '.join(cores)}")
    if names[-1] not in cores:
        raise unknown_name("core", names[-1], cores)
    return cores[names[-1]]


class HostNode(CoreNode):
    """Hosts the core that the parameter `core` names."""

    def __init__(self) -> None:
        """Say which."""
        core = chosen(sys.argv)
        super().__init__(core)
        self.declare("core", core.name, "name of the core that it hosts")


main = main_of(HostNode)

if __name__ == "__main__":
    main()
