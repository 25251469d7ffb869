"""The stream of set points to PX4: the suite's, a held one, or its own position, within limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from tombo_control.safety.flight_volume import clamp_to_volume, outside_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase, PositionSetpoint, is_finite
from tombo_dynamics.records import parameter_record
from tombo_dynamics.rotation import tilt
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.session import SetpointSource
from tombo_px4.link import messages
from tombo_px4.link.messages import MessageTarget, VehicleOdometry


@dataclass(frozen=True)
class FlightLimits:
    """The flight volume, and the limits of speed and tilt."""

    volume: FlightVolume = field(default_factory=FlightVolume)
    safety: SafetyParams = field(default_factory=SafetyParams)

    @cached_property
    def _record(self) -> Any:
        return parameter_record(self.volume)

    def inside(self, setpoint: PositionSetpoint) -> tuple[PositionSetpoint, bool]:
        """Return a set point inside of the volume, and whether it was moved."""
        place = setpoint.position.astype(float)
        moved = clamp_to_volume(place, self._record)
        if not moved:
            return setpoint, False
        still = np.zeros(3)
        return replace(setpoint, position=place, velocity=still, acceleration=still), True

    def broken(self, odometry: VehicleOdometry) -> str:
        """Return which limit the vehicle is beyond; "" if none."""
        away = outside_volume(odometry.position, self._record)
        if away > self.volume.margin:
            return f"{away:.2f} m outside of the flight volume (volume)"
        speed = float(np.linalg.norm(odometry.velocity))
        if speed > self.safety.speed_max:
            return (
                f"{speed:.1f} m/s fast, allowed are {self.safety.speed_max:g} (safety.speed_max)"
            )
        lean = float(tilt(odometry.attitude[None])[0])
        if lean > self.safety.tilt_max:
            return (
                f"tilted by {lean:.2f} rad, allowed are {self.safety.tilt_max:g} (safety.tilt_max)"
            )
        return ""


_ATTITUDE_LAG_S = 0.2
"""PX4's attitude is so late: 1 / MC_PITCH_P is 0.15 s, rate loop and link take 0.05 s. It was
measured best of 0 to 0.3 s."""
_TIMEOUT_NS = SECOND_NS // 2
"""Time without a set point after which the last position is held [ns]."""


class SetpointStream:
    """Keeps the newest set point of the suite and sends it at the rate of the stream."""

    def __init__(self, params: BridgeParams, target: MessageTarget, limits: FlightLimits) -> None:
        self._params = params
        self._target = target
        self._limits = limits
        self._moved_inside = False
        self._setpoint: PositionSetpoint | None = None
        self._setpoint_ns = -(10**18)
        self._new = False
        self.ceiling = math.inf
        """Highest set point now [m], in map."""
        self._stream = SetpointSource.PRESENT
        self._hold_setpoint: PositionSetpoint | None = None
        self._streamed_ns = 0
        self.sent = 0

    def setpoint(self, setpoint: PositionSetpoint, now_ns: int) -> bool:
        """Take a set point; False: not finite, not taken."""
        if not is_finite(setpoint):
            return False
        setpoint, self._moved_inside = self._limits.inside(setpoint)
        self._setpoint, self._setpoint_ns, self._new = setpoint, now_ns, True
        return True

    def horizontal_distance(self, position: Array) -> float:
        """Return the horizontal distance of a position (3) from the set point [m]; 0: none."""
        setpoint = self._setpoint
        if setpoint is None:
            return 0.0
        return math.dist(position[:2].tolist(), setpoint.position[:2].tolist())

    @property
    def phase(self) -> int:
        """Phase of the mission, as its last set point says."""
        return Phase.IDLE if self._setpoint is None else self._setpoint.phase

    @property
    def takeoff_commands(self) -> int:
        """Number of take-off requests of an operator, from the mission's last set point."""
        return 0 if self._setpoint is None else self._setpoint.takeoff_commands

    def fresh(self, now_ns: int) -> bool:
        """Return whether set points are coming."""
        return now_ns - self._setpoint_ns <= _TIMEOUT_NS

    def silent_s(self, now_ns: int) -> float:
        """Return the time since the last set point [s]; 0 if none ever came."""
        return 0.0 if self._setpoint is None else (now_ns - self._setpoint_ns) * 1e-9

    @property
    def follows_suite(self) -> bool:
        """Whether the suite's set points are sent."""
        return self._stream == SetpointSource.SETPOINT

    def clock_set_back(self, now_ns: int) -> None:
        """Forget all times of the past, because the clock was set back."""
        self._streamed_ns = 0
        self._setpoint_ns = min(self._setpoint_ns, now_ns)

    def message(
        self, stream: SetpointSource, present: PositionSetpoint | None, now_ns: int
    ) -> Any | None:
        """Return the message to send now; None: nothing.

        Args:
            stream: which set point the session wants.
            present: the vehicle's own position; None: not known.
            now_ns: the present.
        """
        if stream != self._stream:
            self._stream, self._hold_setpoint = stream, None
            self._streamed_ns = 0
        due = now_ns - self._streamed_ns >= SECOND_NS / self._params.stream_rate
        setpoint = present
        if stream == SetpointSource.SETPOINT:
            due, setpoint = due or self._new, self._wanted(now_ns)
        elif stream == SetpointSource.HOLD:
            setpoint = self._hold_setpoint = self._hold_setpoint or present
        self._new = False
        if setpoint is None or not due or stream == SetpointSource.NONE:
            return None
        self._streamed_ns = now_ns
        self.sent += 1
        return self._position(setpoint, now_ns)

    def _position(self, setpoint: PositionSetpoint, now_ns: int) -> Any:
        """Return a set point as a message; its velocity is ahead by the lag of PX4's attitude."""
        if setpoint.position[2] > self.ceiling:
            x, y, _ = setpoint.position
            level = np.array([1.0, 1.0, 0.0])
            setpoint = replace(
                setpoint,
                position=np.array([x, y, self.ceiling]),
                velocity=level * setpoint.velocity,
                acceleration=level * setpoint.acceleration,
            )
        lead = _ATTITUDE_LAG_S * setpoint.acceleration
        setpoint = replace(setpoint, velocity=setpoint.velocity + lead)
        return messages.position_target(setpoint, self._target, now_ns)

    def _wanted(self, now_ns: int) -> PositionSetpoint | None:
        """Return the set point of the suite; a silent one is kept, at rest."""
        setpoint = self._setpoint
        if setpoint is None or self.fresh(now_ns):
            return setpoint
        still = np.zeros(3)
        return replace(setpoint, velocity=still, acceleration=still)

    def faults(self, now_ns: int) -> dict[str, str]:
        """Return the faults of the set points while the vehicle follows them."""
        faults = {}
        if not self.fresh(now_ns):
            faults["setpoint_silent"] = (
                f"no set point for {self.silent_s(now_ns):.1f} s: the last position is held"
            )
        if self._moved_inside:
            faults["setpoint_outside"] = (
                "set point outside of the flight volume: moved to its border (volume)"
            )
        return faults
