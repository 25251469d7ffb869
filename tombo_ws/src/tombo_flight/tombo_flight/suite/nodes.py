"""Which nodes the suite has, how each is started, and the ROS_DOMAIN_ID of a flight."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from tombo_dynamics.core import Core
from tombo_flight.own_files import with_imports
from tombo_flight.several_vehicles import vehicle_names
from tombo_flight.suite.supervisor import Program
from tombo_sim.wiring import CORES, PX4_REPLACES

HIGHEST_DOMAIN = 232
"""Above it the ports do not fit (DDSI-RTPS 9.6.1.1)."""
HIGHEST_PRIVATE = 101
"""Above it the ports reach into the range that Linux gives away by itself."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCALHOST = "LOCALHOST"
_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
_FAST_DDS = "rmw_fastrtps_cpp"
_FIRST_PORT = 7400
_PORTS = 250


def free_domain(first: int, ports: Collection[int]) -> int:
    """Return a domain from 1 to 101 none of whose UDP ports is in use.

    Args:
        first: any number, as that of the process; the search begins there.
        ports: UDP ports in use.
    """
    busy = {(port - _FIRST_PORT) // _PORTS for port in ports}
    candidates = [1 + (first + i) % HIGHEST_PRIVATE for i in range(HIGHEST_PRIVATE)]
    return next((domain for domain in candidates if domain not in busy), candidates[0])


def udp_ports() -> set[int]:
    """Return the UDP ports that are in use on this machine, as far as it tells."""
    ports = set()
    for table in (Path("/proc/net/udp"), Path("/proc/net/udp6")):
        try:
            rows = table.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        ports |= {int(row.split()[1].rpartition(":")[2], 16) for row in rows if row.strip()}
    return ports


HOST = "tombo_flight.suite.core_node"
"""Hosts the core that its parameter `core` names."""


def node_module(core: type[Core]) -> str:
    """Return the module of the node that hosts a core: it runs next to it, or is the host."""
    beside = core.__module__.removesuffix("_core") + "_node"
    return HOST if find_spec(beside) is None else beside


RECORDER = "tombo_ros.recorder_node"
SUITE: dict[str, str] = {
    "sim": "tombo_sim.sim_node",
    **{core.name: node_module(core) for core in CORES},
    "recorder": RECORDER,
}
"""Name of each node → its module. The order in which they start is of no importance."""
BRIDGE = "px4_bridge"
PX4_SUITE: dict[str, str] = {
    "sim": "tombo_px4.px4_sim_node",
    BRIDGE: "tombo_px4.px4_bridge_node",
    **{core.name: node_module(core) for core in CORES if core not in PX4_REPLACES},
    "recorder": RECORDER,
}
"""The suite over MAVLink: PX4 estimates and controls. `sim` plays PX4, vehicle and mocap; with a
vehicle of its own at the other end of the link it is left out."""
HIL_SIM = "tombo_px4.hil_sim_node"
"""`sim` of a real PX4: vehicle and mocap behind its simulator link."""
GROUP = "tombo_flight.suite.group_node"
"""Hosts several nodes of `SUITE`."""


def groups(vehicles: int) -> dict[str, tuple[str, ...]]:
    """Return the processes of several vehicles, with the nodes of each, as v1/estimator."""
    names = vehicle_names(vehicles)
    return {
        "sim": tuple(f"{name}/sim" for name in names),
        **{name: tuple(f"{name}/{core.name}" for core in CORES) for name in names},
        "recorder": ("recorder",),
    }


def suite_of(vehicles: int) -> dict[str, str]:
    """Return the processes of several vehicles, name → module."""
    return dict.fromkeys(groups(vehicles), GROUP) | {"recorder": RECORDER}


MONITOR = "monitor"
MONITOR_MODULE = "tombo_flight.suite.monitor_node"
"""Not of the suite: forwards `/diagnostics` to the supervisor."""


def node_program(
    name: str,
    parameters: Path,
    suite: Mapping[str, str] | None = None,
    members: Sequence[str] = (),
) -> Program:
    """Return how to start a node of a suite, or a group of them, with a file of parameters."""
    module = (SUITE if suite is None else suite)[name]
    core = ("-p", f"core:={name}") if module == HOST else ()
    ros = ("--ros-args", *core, "--params-file", str(parameters))
    hosted = members if module == GROUP else ()
    command = (sys.executable, *with_imports(module), *hosted, *ros)
    return Program(name, command, ends_last=module == RECORDER)


def monitor_program(*arguments: str) -> Program:
    """Return how to start the monitor."""
    return Program(
        MONITOR, (sys.executable, "-m", MONITOR_MODULE, *arguments), capture_stdout=True
    )


def local_discovery(base: Mapping[str, str]) -> dict[str, str]:
    """Return variables that keep DDS on this machine, unless `base` asks for more.

    Fast DDS then uses UDP on the loopback interface, as `loopback.xml` says, and no shared memory.
    With a profile of the user's, or another middleware, ROS 2 alone restricts the discovery.
    """
    if base.get(_RANGE, _LOCALHOST) != _LOCALHOST:
        return {}
    if _PROFILES in base or base.get("RMW_IMPLEMENTATION", _FAST_DDS) != _FAST_DDS:
        return {_RANGE: _LOCALHOST}
    # with LOCALHOST, rmw_fastrtps_cpp adds shared memory whatever the profile says
    return {_RANGE: "SUBNET", _PROFILES: str(Path(__file__).with_name("loopback.xml"))}


def node_environment(
    base: Mapping[str, str], folder: Path, domain: int | None = None
) -> dict[str, str]:
    """Return the environment of the nodes.

    Args:
        base: that of this process.
        folder: of ROS's own log files.
        domain: ROS_DOMAIN_ID; None: that of `base`.
    """
    discovery = discovery_environment(base, domain)
    return {"ROS_LOG_DIR": str(folder), **discovery, "PYTHONUNBUFFERED": "1"}


def discovery_environment(base: Mapping[str, str], domain: int | None = None) -> dict[str, str]:
    """Return the environment of a process that finds the nodes of this machine.

    Args:
        base: that of this process.
        domain: ROS_DOMAIN_ID; None: that of `base`.
    """
    chosen = {**base, **local_discovery(base)}
    if domain is not None:
        chosen["ROS_DOMAIN_ID"] = str(domain)
    return chosen
