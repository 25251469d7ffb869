"""The PX4 of a flight over MAVLink: simulated or at a URL, and the search for its vehicle."""

from __future__ import annotations

import dataclasses
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.params import from_mapping
from tombo_flight.scenario import override
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams, LinkParams
from tombo_px4.bridge.link_health import link_faults
from tombo_px4.bridge.vehicle_parameters import SETS, parse_assignments
from tombo_px4.link.mavlink_link import Link, parse_url, read_key
from tombo_px4.link.messages import is_armed
from tombo_px4.link.vehicle_link import PATIENCE_S, VehicleLink
from tombo_px4.modes import mode_name, mode_of

_RECORDS: Final[dict[str, type[LinkParams] | type[BridgeParams]]] = {
    "link": LinkParams,
    "px4": BridgeParams,
}
"""Sections of the bridge's parameters."""
_PX4_PARAMETERS: Final = "px4_parameters"
"""The bridge's list of parameters that it sets in PX4."""
_HERE: Final = "127.0.0.1"


@dataclass(frozen=True)
class Px4Connection:
    """How the bridge reaches PX4.

    Attributes:
        link: parameters of the bridge's link.
        bridge: parameters of the bridge.
        endpoint: URL of the simulated PX4's end; empty: there is a PX4 already.
        hil_port: where that PX4 finds its simulator, which flies along; 0: it has a vehicle.
        writes: NAME=VALUE of PX4's parameters that the bridge sets before the flight.
    """

    link: LinkParams
    bridge: BridgeParams
    endpoint: str = ""
    hil_port: int = 0
    writes: tuple[str, ...] = ()

    @property
    def simulated(self) -> bool:
        """Whether vehicle and motion capture are simulated along with the flight."""
        return bool(self.endpoint or self.hil_port)

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Node → parameters that a scenario has not."""
        both: dict[str, Any] = {
            "link": dataclasses.asdict(self.link),
            "px4": dataclasses.asdict(self.bridge),
        }
        found: dict[str, dict[str, Any]] = {"px4_bridge": both}
        if self.writes:
            both[_PX4_PARAMETERS] = list(self.writes)
        if self.hil_port:
            found["sim"] = {"port": self.hil_port}
        elif self.simulated:
            found["sim"] = {
                "onboard_url": self.endpoint,
                "ground_url": "",
                "key_file": self.link.key_file,
            }
        return found


def px4_connection(url: str | None, settings: Sequence[str]) -> Px4Connection:
    """Return the other end, checked.

    Args:
        url: of the bridge's link to a PX4 that is there; None: simulate one, on a free port.
        settings: of the bridge, as `px4.stream_rate=50`.

    Raises:
        InputError: unknown parameter, or a value that is not accepted.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        values = override(values, setting, "--bridge", "px4.stream_rate=50")
    writes = _writes(values.pop(_PX4_PARAMETERS, []))
    for section in values:
        if section not in _RECORDS:
            raise unknown_name("section of --bridge", section, [*_RECORDS, _PX4_PARAMETERS])
    if "url" in _section(values, "link"):
        raise InputError("--bridge link.url: accepted: the URL behind --px4")
    endpoint = ""
    if url is None:
        port = free_udp_port()
        for name in parse_assignments(writes):
            if name not in ParameterTable().names:
                raise unknown_name(_PX4_PARAMETERS, name, ParameterTable().names)
        url, endpoint = f"udpin://{_HERE}:{port}", f"udpout://{_HERE}:{port}"
    link = from_mapping(LinkParams, {**_section(values, "link"), "url": url}, "link")
    wanted = dict(_section(values, "px4"))
    if endpoint:
        wanted.setdefault("axes_evidence", SIMULATED)
    elif wanted.get("axes_evidence") == SIMULATED:
        raise InputError(
            f"--bridge px4.axes_evidence={SIMULATED}: accepted: without a URL, where this command"
            " simulates the vehicle; prove the axes by hand (docs/px4.md)"
        )
    bridge = from_mapping(BridgeParams, wanted, "px4")
    link_key(link)
    parse_url(link.url, link.allow_remote)
    return Px4Connection(link, bridge, endpoint, writes=writes)


def _writes(given: Any) -> tuple[str, ...]:
    """Return the assignments of PX4's parameters.

    Raises:
        InputError: they are not a list of NAME=VALUE.
    """
    if isinstance(given, str):
        given = [given]
    if not isinstance(given, list):
        raise InputError(
            f"{_PX4_PARAMETERS}: {shown(given)} is not a list; accepted: {', '.join(SETS)}, or a "
            "list as [safe, NAME=VALUE]"
        )
    found = tuple(map(str, given))
    parse_assignments(found)
    return found


def _section(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the values of a section.

    Raises:
        InputError: the section is not a mapping.
    """
    found = values.get(name, {})
    if not isinstance(found, Mapping):
        raise InputError(f"--bridge {name}={shown(found)}: accepted: a parameter of {name}")
    return found


def link_key(link: LinkParams) -> bytes | None:
    """Return the signing key; None without one.

    Raises:
        InputError: its file can't be read, or is not a key.
    """
    return read_key(link.key_file, lambda warning: None)


def free_udp_port() -> int:
    """Return a UDP port of this machine that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((_HERE, 0))
        return int(probe.getsockname()[1])


_PX4: Final = 12
"""MAV_AUTOPILOT_PX4."""
_KINDS: Final = {2: "quadrotor", 13: "hexarotor", 14: "octorotor"}
_SIGNED = 1
"""MAVLINK_IFLAG_SIGNED."""


@dataclass(frozen=True)
class Vehicle:
    """An autopilot, from its HEARTBEAT."""

    system: int
    component: int
    armed: bool
    mode: str
    kind: str

    @property
    def description(self) -> str:
        """Text for the user."""
        state = "armed" if self.armed else "disarmed"
        return f"a PX4 {self.kind}, system {self.system}, {state}, in mode {self.mode}"


def find_vehicle(
    params: LinkParams,
    *,
    parameters: Sequence[str] = (),
    patience_s: float = PATIENCE_S,
    stop: Callable[[], bool] = lambda: False,
) -> Vehicle | None:
    """Wait for the heartbeat of the vehicle that a bridge with these parameters would fly.

    Args:
        params: of the bridge's link.
        parameters: names of PX4's parameters that it must know.
        patience_s: how long to wait.
        stop: ends the waiting.

    Returns:
        The vehicle, None if it was stopped before.

    Raises:
        InputError: the link can't be opened; the vehicle is missing or another one; or it does not
        know a parameter.
    """
    with VehicleLink(params, link_key(params), time.time_ns, patience_s, stop) as link:
        if stop():
            return None
        vehicle = vehicle_on(link, params, patience_s)
        asked = () if vehicle.armed else parameters
        unknown = sorted(set(asked) - link.parameters(asked).keys())
        if unknown and not stop():
            raise InputError(
                f"px4_parameters: PX4 does not know {', '.join(unknown)}; accepted: names of its"
                " own parameters"
            )
        return vehicle


def vehicle_on(link: VehicleLink, params: LinkParams, patience_s: float = PATIENCE_S) -> Vehicle:
    """Return the vehicle of an open link with these parameters.

    Raises:
        InputError: the vehicle is missing or another one, or it signs and this side does not.
    """
    if link.heartbeat is None:
        raise InputError(_no_vehicle_text(link.link, params, patience_s))
    if not params.key_file and _signed(link.heartbeat):
        raise InputError(
            f"link '{params.url}': PX4 signs its messages and this side has no key: "
            "--bridge link.key_file=…; accepted: the file of PX4's key"
        )
    return _parse_heartbeat(link.heartbeat)


def _signed(message: Any) -> bool:
    return bool(message.get_header().incompat_flags & _SIGNED)


def _parse_heartbeat(heartbeat: Any) -> Vehicle:
    system, component = heartbeat.get_srcSystem(), heartbeat.get_srcComponent()
    if heartbeat.autopilot != _PX4:
        raise InputError(
            f"system {system}, component {component}: autopilot {heartbeat.autopilot} is not PX4; "
            f"accepted: PX4 ({_PX4})"
        )
    return Vehicle(
        system,
        component,
        is_armed(heartbeat),
        mode_name(mode_of(heartbeat.custom_mode)),
        _KINDS.get(heartbeat.type, f"vehicle of type {heartbeat.type}"),
    )


def _no_vehicle_text(link: Link, params: LinkParams, patience_s: float) -> str:
    """Return in one line why the vehicle is missing."""
    heard = "; ".join(link_faults(link, params, linked=False).values())
    return (
        f"link '{params.url}': no heartbeat within {patience_s:g} s{heard and f' ({heard})'};"
        " accepted: a link on which a PX4 speaks MAVLink 2"
    )
