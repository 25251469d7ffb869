"""Conditions that end a flight: limits, poses that are lost or jump, findings of the checks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import Checklist, Finding, confirms_axes
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.link.messages import VehicleOdometry

_MEASURE_NS = SECOND_NS // 20
"""Period of the checks of the motion [ns]."""
_UNFIT_NS = 2 * SECOND_NS
"""PX4 calls a vehicle airborne that still stands and spools up."""
_LIFTED_M = 0.05
_JUMP_NS = SECOND_NS // 4
"""Single poses with exchanged markers are left out; what stays away for longer has moved."""
_CHECK_HEIGHT_M, _CHECK_NS = 0.6, 8 * SECOND_NS
"""The vehicle stays below this height until its motion has shown the axes, for this time at most
[ns]. Wrong axes then end below 1 m; over a real PX4 they show 2 to 7 s after the lift-off."""
_REPEATED_NS = 100_000_000
"""A driver may send a pose twice; the same bits for longer are not a new pose [ns]."""


class RepeatedPose:
    """Finds poses whose bits do not change although the vehicle moves.

    A real motion capture has noise. A simulated pose without noise is a pose at rest, as long as
    the gyro does not turn and the vehicle does not fly.
    """

    def __init__(self) -> None:
        self._pose: Array = np.full(7, math.nan)
        self._since_ns = 0
        self._moves = False

    def moves(self) -> None:
        """Take note that the vehicle turns or flies now."""
        self._moves = True

    def repeats(self, now_ns: int, position: Array, attitude: Array) -> bool:
        """Take a pose; return whether it repeats an old one of a vehicle that moves."""
        pose = np.concatenate([position, attitude])
        if not np.array_equal(pose, self._pose):
            self._pose, self._since_ns, self._moves = pose, now_ns, False
        return self._moves and now_ns - self._since_ns > _REPEATED_NS


class FlightWatch:
    """Decides whether, and why, a flight must end.

    Attributes:
        mistake: fault of the motion of the poses in this flight; None: no fault is known. Then no
            pose is sent before the disarming.
        pose_ns: arrival of the last pose that was sent.
        jump_ns: since when poses are elsewhere than PX4; None: they agree.
        distrusts: poses were judged wrong in this flight: none is sent before the disarming.
    """

    def __init__(self, params: BridgeParams, limits: FlightLimits, checklist: Checklist) -> None:
        self._params = params
        self._limits = limits
        self._checklist, self._motion = checklist, checklist.motion
        self.mistake: Finding | None = None
        self.pose_ns = 0
        self.jump_ns: int | None = None
        self.distrusts = False
        self._unfit_ns: int | None = None
        self._limit_ns: int | None = None
        self._measured_ns = 0
        self._was_armed = False
        self._beside_m = 0.0
        """Horizontal distance from the set point at the arming [m]."""
        self._begin_m = math.nan
        """Height of the pose at the arming, in map [m]."""
        self._lifted_ns: int | None = None

    def ceiling(self, now_ns: int) -> float:
        """Return the highest place to fly to now, in map [m]: low until the axes have shown."""
        position = self._checklist.latest_position
        if not self._was_armed or position is None or self._motion.confirmed:
            self._lifted_ns, self._begin_m = None, math.nan
            return math.inf
        height = float(position[2])
        if math.isnan(self._begin_m):
            self._begin_m = height
        if self._lifted_ns is None and height > self._begin_m + _LIFTED_M:
            self._lifted_ns = now_ns
        return self._begin_m + _CHECK_HEIGHT_M if self._checks_takeoff(now_ns) else math.inf

    def _checks_takeoff(self, now_ns: int) -> bool:
        """Return whether the axes have to show yet."""
        waits = self._lifted_ns is None or now_ns - self._lifted_ns < _CHECK_NS
        return waits and not self._motion.confirmed

    def rest(self) -> None:
        """Forget since when something is wrong: the vehicle does not fly."""
        self._unfit_ns = self._limit_ns = None

    def follow(self, now_ns: int, armed: bool, takes_off: bool, beside_m: float) -> Finding | None:
        """Compare the motion since the arming with that of PX4's sensors.

        Args:
            now_ns: the present.
            armed: the vehicle is.
            takes_off: it follows a mission that takes off.
            beside_m: horizontal distance from the set point.

        Returns:
            the mistake, in the tick in which it is detected.
        """
        motion = self._motion
        if armed != self._was_armed:
            self._was_armed, self.distrusts, self.mistake = armed, False, None
            self._beside_m = beside_m
            (motion.begin if armed else motion.end)()
        if not armed or 0 <= now_ns - self._measured_ns < _MEASURE_NS:
            return None
        self._measured_ns = now_ns
        motion.measure()
        if self.mistake is not None:
            return None
        drift_m = beside_m - self._beside_m if takes_off else 0.0
        silent_s = (now_ns - self.pose_ns) * 1e-9
        checks = self._checks_takeoff(now_ns)
        for finding in self._checklist.motion_findings(drift_m, checks, silent_s)[:1]:
            self.mistake, self.distrusts = finding, True
            motion.accuse(finding.check.rotated)
            return finding
        if not motion.confirmed and confirms_axes(motion):
            motion.confirm()
        return None

    def must_land(
        self, now_ns: int, odometry: VehicleOdometry | None, findings: Sequence[Finding]
    ) -> str:
        """Return why the flight must end, "" if it may go on.

        Args:
            now_ns: the present.
            odometry: PX4's last estimate.
            findings: of the checks.
        """
        if self.mistake is not None:
            return self.mistake.text
        broken = "" if odometry is None else self._limits.broken(odometry)
        self._limit_ns = (self._limit_ns or now_ns) if broken else None
        limit_ns = self._limits.safety.limit_time * SECOND_NS
        if self._limit_ns is not None and now_ns - self._limit_ns > limit_ns:
            return broken
        pose_s = (now_ns - self.pose_ns) * 1e-9
        if pose_s > self._params.pose_loss_time:
            blocking = (f for f in findings if f.check.blocks)
            refused = (f.text for f in blocking if f.check.key.startswith("pose_"))
            return next(refused, f"no mocap pose for {pose_s:.1f} s")
        if self.jump_ns is not None and now_ns - self.jump_ns > _JUMP_NS:
            return PoseRefusal.JUMP.text
        unfit = next((f.text for f in findings if f.check.ends_flight), "")
        self._unfit_ns = (self._unfit_ns or now_ns) if unfit else None
        if self._unfit_ns is None or now_ns - self._unfit_ns < _UNFIT_NS:
            return ""
        self.distrusts = True
        return unfit
