"""Health of the link to PX4: rates of its messages, and the fault of a silent link."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.bridge_params import BridgeParams, LinkParams
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import MessageTarget, command

_WINDOW_NS = 2 * SECOND_NS
_TOO_SLOW, _MOST_REQUESTS = 0.6, 5
_SLOW_SHARE = 0.4
"""Less than this share of the rate asked for is a fault."""
_STATE_HZ, _BATTERY_HZ, _ESTIMATOR_HZ, _THRUST_HZ = 10.0, 2.0, 5.0, 10.0


class MessageRates:
    """Counts arrivals within the last two seconds, and requests messages of too low a rate."""

    def __init__(self, params: BridgeParams, target: MessageTarget) -> None:
        self._target = target
        self._wanted = {
            "ODOMETRY": params.odometry_rate,
            "HIGHRES_IMU": params.imu_rate,
            "EXTENDED_SYS_STATE": _STATE_HZ,
            "BATTERY_STATUS": _BATTERY_HZ,
            "ESTIMATOR_STATUS": _ESTIMATOR_HZ,
            "ATTITUDE_TARGET": _THRUST_HZ,
        }
        self._times: dict[str, deque[int]] = {}
        self._requests: Counter[str] = Counter()

    def count(self, name: str, time_ns: int) -> None:
        """Count a message."""
        times = self._times.setdefault(name, deque(maxlen=1000))
        times.append(time_ns)

    def rate_hz(self, name: str, now_ns: int) -> float:
        """Return how often a message came per second, lately."""
        times = self._times.get(name)
        if not times:
            return 0.0
        while times and now_ns - times[0] > _WINDOW_NS:
            times.popleft()
        return len(times) / (_WINDOW_NS * 1e-9)

    def rates(self, now_ns: int) -> dict[str, float]:
        """Return all rates [Hz]."""
        return {name: self.rate_hz(name, now_ns) for name in sorted(self._times)}

    def clear(self) -> None:
        """Forget all arrivals."""
        self._times.clear()

    def requests(self, now_ns: int, begun: bool) -> list[Any]:
        """Return requests for messages of too low a rate; `begun`: for everything."""
        messages = []
        if begun:
            self._requests.clear()
        for name, rate in self._wanted.items():
            slow = self.rate_hz(name, now_ns) < _TOO_SLOW * rate
            if begun or (slow and self._requests[name] < _MOST_REQUESTS):
                self._requests[name] += 1
                number = float(getattr(mav, f"MAVLINK_MSG_ID_{name}"))
                asked = (number, round(1e6 / rate))
                messages.append(command(self._target, mav.MAV_CMD_SET_MESSAGE_INTERVAL, *asked))
        return messages

    def faults(self, now_ns: int) -> dict[str, str]:
        """Return key -> fault of the messages that are vital and come far too seldom."""
        faults = {}
        for name in ("ODOMETRY", "HIGHRES_IMU"):
            rate, wanted = self.rate_hz(name, now_ns), self._wanted[name]
            if 0.0 < rate < _SLOW_SHARE * wanted:
                faults[f"slow.{name}"] = (
                    f"{name} comes at {rate:.0f} Hz, {wanted:.0f} Hz were asked for: raise the"
                    " rate of PX4's link (MAV_0_RATE, baud), or ask for less"
                )
        return faults


_UNSIGNED = {
    "unsigned": "messages without a signature were left out: link.key_file is set here, but the "
    "other side does not sign",
    "bad_signature": "messages are signed with another key: compare link.key_file with the "
    "vehicle's key",
}
"""Counter of the link → fault."""


def link_faults(link: Link, params: LinkParams, linked: bool) -> dict[str, str]:
    """Return key -> fault of the link, with cause and remedy.

    Args:
        link: received, sent and refused messages.
        params: whom we wait for.
        linked: the vehicle is heard.
    """
    faults: dict[str, str] = {}
    counters, rejected_sender = link.counters, link.mav.rejected_sender
    if link.pack_error:
        faults["unsendable"] = link.pack_error
    if linked:
        return faults
    if rejected_sender is not None:
        system, component = rejected_sender
        if system != params.system:
            faults["wrong_system"] = (
                f"system {system} speaks here, waiting for {params.system}: set "
                f"link.system={system}, or the vehicle's MAV_SYS_ID"
            )
        else:
            faults["wrong_component"] = (
                f"component {component} of system {system} speaks here, "
                f"waiting for {params.component}: set link.component={component}"
            )
    for key, text in _UNSIGNED.items():
        if counters[key]:
            faults[key] = f"{counters[key]} {text}"
    if not counters["received"] and counters["garbage_bytes"] > 1000:
        faults["garbage"] = (
            f"{counters['garbage_bytes']} bytes came that are no MAVLink: baud rate, or another"
            " program on this port"
        )
    return faults
