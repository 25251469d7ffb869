"""A flight over MAVLink by the bridge's status: does PX4 take off, and figures of a summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from tombo_bag.flight import Flight, Topic
from tombo_bag.recording import Recording
from tombo_bag.topics import PX4_STATUS
from tombo_dynamics.messages import Phase
from tombo_flight.suite.node_diagnostics import NodeStatus, recorded_diagnostics
from tombo_px4.bridge.session import SessionStage

READY_S: Final = 25.0
"""Time from the bridge's first status: EKF2 converges, checks pass, the vehicle arms."""
START_S: Final = 60.0
"""Time from the start of the processes to the bridge's first status."""
_DISARM_S: Final = 12.0
"""Time after the flight: PX4 disarms 2 s after landing, the bridge asks 4 s after it."""
_GIVEN_UP: Final = SessionStage.GIVEN_UP.value
_LOSSES: Final = ("flight_lost", "axes_wrong", "disarmed")
"""Faults with which the bridge, or PX4, ends a flight that nobody has ended."""
_METRIC_KEYS: Final = {
    "time_offset_ns": "timesync_offset_ns",
    "time_round_trip_us": "timesync_round_trip_us",
    "mocap_latency_ms": "mocap_latency_ms",
    "mocap_rate_hz": "mocap_rate_hz",
    "odometry_latency_ms": "odometry_latency_ms",
    "poses_sent": "poses_sent",
    "setpoints_sent": "setpoints_sent",
    "messages_in": "link.received",
    "messages_out": "link.sent",
}
"""Key of the summary → of the bridge's diagnostics."""


class BridgeMonitor:
    """Follows `/px4/status`: whether it arms, and whether it is at rest at the end."""

    def __init__(self) -> None:
        self.refusal = ""
        """Why the vehicle does not take off, or did not; empty as long as it may."""
        self._phase: int | None = None
        self._status: Mapping[str, Any] = {}
        self._began_s: float | None = None
        self._first_s: float | None = None
        """When the bridge's first status came."""
        self._over_s: float | None = None
        self._armed_once = False
        self._now_s = 0.0
        self._lost = False
        self._ended_because = ""
        """Why the bridge has begun to land, or has given up: its last message."""
        self._fault = ""

    @property
    def armed(self) -> bool:
        """Whether the vehicle is armed, as far as the bridge knows."""
        return bool(self._status.get("armed", False))

    @property
    def mode(self) -> str:
        """Flight mode of PX4; "unknown" before its first report."""
        return str(self._status.get("mode", "")) or "unknown"

    @property
    def loss(self) -> str:
        """Which loss has ended the flight; empty: none has."""
        return (self._ended_because or self._fault) if self._lost else ""

    @property
    def at_rest(self) -> bool:
        """Disarmed after the flight, not coming down at all, or waited for long enough."""
        if not self.armed or self._phase not in (Phase.LAND, Phase.LANDED, Phase.DESCEND_BLIND):
            return True
        return self._over_s is not None and self._now_s - self._over_s > _DISARM_S

    def see(
        self,
        status: Mapping[str, Any] | None,
        phase: int | None,
        now_s: float,
        *,
        over: bool,
        airborne: bool = False,
        bridge: NodeStatus | None = None,
    ) -> None:
        """Take a look.

        Args:
            status: the newest of `/px4/status` as plain values; None: no news.
            phase: of the mission; None: unknown.
            now_s: any clock that goes on.
            over: the flight is over.
            airborne: the vehicle has left the ground.
            bridge: the bridge's values on `/diagnostics`; None: nothing yet.
        """
        self._now_s = now_s
        self._phase = phase
        if self._began_s is None:
            self._began_s = now_s
        if status is not None and self._first_s is None:
            self._first_s = now_s
        if over and self._over_s is None:
            self._over_s = now_s
        if status is not None:
            self._status = status
            if status["stage"] in (SessionStage.LANDING.value, _GIVEN_UP):
                self._ended_because = str(status["why"]) or self._ended_because
        self._armed_once |= self.armed
        if bridge is not None:
            self._fault = bridge.message or self._fault
            counted = (f"fault.{key}" in bridge.values for key in _LOSSES)
            self._lost |= self._armed_once and any(counted)
        fault = "" if bridge is None else bridge.message
        if not self._armed_once:
            self.refusal = self._why_not(phase, now_s, fault)
        elif not (self.armed or airborne or over) and self._flight_impossible(phase):
            why = self._failure_text(fault)
            self.refusal = f"it armed, but by its poses it never left the ground: {why}"

    def _flight_impossible(self, phase: int | None) -> bool:
        """Whether neither mission nor bridge will fly any more."""
        return phase == Phase.LANDED or self._status.get("stage") == _GIVEN_UP

    def _failure_text(self, fault: str) -> str:
        """Return the bridge's values of it; PX4's last words only where it knows nothing."""
        said = self.loss or self._ended_because or fault
        status = self._status
        return str(said or status["status_text"] or status["why"] or "PX4 disarmed it")

    def _why_not(self, phase: int | None, now_s: float, fault: str) -> str:
        """Return why it is not armed, once it has had its time; "" before."""
        status = self._status
        if self._first_s is None:
            waited_s = now_s - (self._began_s or 0.0)
            silent = "the bridge has said nothing"
            return f"{silent} for {waited_s:.0f} s" if waited_s >= START_S else ""
        waited_s = now_s - self._first_s
        if status.get("stage") == _GIVEN_UP:
            return f"PX4 did not take off: {status['why']}"
        if phase != Phase.LANDED and waited_s < READY_S:
            return ""
        waited = f"PX4 was not armed within {waited_s:.0f} s"
        if not status["connected"]:
            return f"{waited}: no heartbeat"
        found = fault or "; ".join(status["findings"]) or status["why"] or status["status_text"]
        return f"{waited}: {found or 'it stands ' + str(status['stage'])}"


def px4_metrics(recording: Recording, flight: Flight) -> dict[str, Any]:
    """Return the summary's section on PX4; values not reported are None."""
    status = flight.topics.get(PX4_STATUS.name, Topic())
    bridge = recorded_diagnostics(recording).nodes.get("px4_bridge")
    values = {} if bridge is None else bridge.values
    end_s = float(flight.t[-1]) if flight.t.size else 0.0
    return {
        "firmware": next((text for _, text in reversed(_changes(status, "firmware"))), None),
        "armed_s": _first(status, "armed"),
        "offboard_s": _first(status, "offboard"),
        "armed_duration_s": _lasted(status, "armed", end_s),
        "offboard_duration_s": _lasted(status, "offboard", end_s),
        "modes": _steps(status, "mode"),
        **{key: _reported_value(values, name) for key, name in _METRIC_KEYS.items()},
        "status_texts": _steps(status, "status_text"),
    }


def _changes(status: Topic, name: str) -> list[tuple[float, Any]]:
    """Return flight time [s] and value of a field of each message of `/px4/status`."""
    series = status.get(name)
    if series is None:
        return []
    times = [round(time_s, 3) for time_s in series.t.tolist()]
    return list(zip(times, series.values.tolist(), strict=True))


def _reported_value(values: Mapping[str, Any], name: str) -> Any:
    value = values.get(name)
    return None if value in ("None", "nan", "") else value


def _first(status: Topic, name: str) -> float | None:
    return next((time_s for time_s, value in _changes(status, name) if value), None)


def _lasted(status: Topic, name: str, end_s: float) -> float:
    """Return how long something was so [s]."""
    changes = _changes(status, name)
    times = [*(time_s for time_s, _ in changes[1:]), end_s]
    spans = (
        max(until - time_s, 0.0)
        for (time_s, value), until in zip(changes, times, strict=False)
        if value
    )
    return round(sum(spans), 3)


def _steps(status: Topic, name: str) -> list[list[Any]]:
    """Return [time, text] of each new text."""
    found: list[list[Any]] = []
    for time_s, text in _changes(status, name):
        if text and (not found or found[-1][1] != text):
            found.append([time_s, text])
    return found
