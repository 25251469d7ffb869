"""Finds the vehicle at the other end of a MAVLink link, before anything is started or armed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tombo_dynamics.errors import InputError
from tombo_flight.suite.px4_connection import link_key
from tombo_px4.link.link_params import LinkParams
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.message_encoder import MessageTarget, read_parameter
from tombo_px4.modes import mode_name, mode_of

PATIENCE_S: Final = 10.0
"""A vehicle that boots says nothing for some seconds."""
_PERIOD_S = 0.1
_ASKED, _ANSWER_S = 4, 0.5
_OWN_HEARTBEAT_S = 0.5
_ON_BOARD, _NO_AUTOPILOT, _PX4, _ACTIVE = 18, 8, 12, 4
"""MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID, MAV_AUTOPILOT_PX4, MAV_STATE_ACTIVE."""
_KINDS: Final = {2: "quadrotor", 13: "hexarotor", 14: "octorotor"}
_ARMED = 128
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
        InputError: the link can't be opened, or there is no vehicle or another one, or it does
            not know a parameter.
    """
    link = Link(
        params.url,
        system=params.own_system,
        component=params.own_component,
        clock=time.time_ns,
        key=link_key(params),
        allow_remote=params.allow_remote,
    )
    try:
        vehicle = _find(link, params, patience_s, stop)
        if vehicle is not None and not vehicle.armed:
            _check_parameters(link, params, parameters, stop)
        return vehicle
    finally:
        link.close()


def _find(
    link: Link, params: LinkParams, patience_s: float, stop: Callable[[], bool]
) -> Vehicle | None:
    others: set[tuple[int, int]] = set()
    end_s = time.monotonic() + patience_s
    spoken_s = -_OWN_HEARTBEAT_S
    while (now_s := time.monotonic()) < end_s:
        if stop():
            return None
        if now_s - spoken_s >= _OWN_HEARTBEAT_S:
            spoken_s = now_s
            link.send(link.mav.heartbeat_encode(_ON_BOARD, _NO_AUTOPILOT, 0, 0, _ACTIVE))
        link.wait(_PERIOD_S)
        for received in link.receive():
            if received.message.get_type() != "HEARTBEAT":
                continue
            sender = (received.system, received.component)
            if sender == (params.system, params.component):
                if not params.key_file and _signed(received.message):
                    raise InputError(
                        f"link '{params.url}': PX4 signs its messages and this side has no key: "
                        "--bridge link.key_file=…; accepted: the file of PX4's key"
                    )
                return _parse_heartbeat(received.message, *sender)
            others.add(sender)
    raise InputError(_no_vehicle_text(link, params, patience_s, others))


def _check_parameters(
    link: Link, params: LinkParams, names: Sequence[str], stop: Callable[[], bool]
) -> None:
    """Ask for parameters until each is known; to an unknown name PX4 is silent.

    Raises:
        InputError: one was not answered.
    """
    target = MessageTarget(params.system, params.component)
    left = set(names)
    for _ in range(_ASKED):
        for name in sorted(left):
            link.send(read_parameter(target, name))
        end_s = time.monotonic() + _ANSWER_S
        while left and time.monotonic() < end_s and not stop():
            link.wait(_PERIOD_S)
            for received in link.receive():
                if received.message.get_type() == "PARAM_VALUE":
                    left.discard(received.message.param_id)
    if left and not stop():
        raise InputError(
            f"px4_parameters: PX4 does not know {', '.join(sorted(left))}; accepted: names of its"
            " own parameters"
        )


def _signed(message: Any) -> bool:
    return bool(message.get_header().incompat_flags & _SIGNED)


def _parse_heartbeat(heartbeat: Any, system: int, component: int) -> Vehicle:
    if heartbeat.autopilot != _PX4:
        raise InputError(
            f"system {system}, component {component}: autopilot {heartbeat.autopilot} is no PX4; "
            f"accepted: PX4 ({_PX4})"
        )
    return Vehicle(
        system,
        component,
        bool(heartbeat.base_mode & _ARMED),
        mode_name(mode_of(heartbeat.custom_mode)),
        _KINDS.get(heartbeat.type, f"vehicle of type {heartbeat.type}"),
    )


def _no_vehicle_text(
    link: Link, params: LinkParams, patience_s: float, others: set[tuple[int, int]]
) -> str:
    """Say in one line why there is no vehicle."""
    wanted = f"system {params.system}, component {params.component}"
    if others:
        listed = ", ".join(f"{s}/{c}" for s, c in sorted(others))
        system, component = min(others)
        return (
            f"link '{params.url}': no heartbeat of {wanted} within {patience_s:g} s, but of "
            f"{listed}; accepted: the vehicle's own ids, as in --bridge link.system={system} "
            f"--bridge link.component={component}"
        )
    refused = {
        key: count
        for key, count in link.counters.items()
        if count and key not in ("received", "sent", "no_peer")
    }
    more = ", ".join(f"{key} {count}" for key, count in refused.items())
    shown = f" (refused: {more})" if more else ""
    return (
        f"link '{params.url}': no heartbeat within {patience_s:g} s{shown}; accepted: a link on "
        "which a PX4 speaks MAVLink 2"
    )
