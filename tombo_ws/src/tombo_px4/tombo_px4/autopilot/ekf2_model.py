"""Where the autopilot thinks it is: IMU with GPS or vision, as EKF2 would have it.

The same observer as in the rest of the suite, fed as EKF2 is: of a pose only position and yaw are
used, tilt comes from gyro and accelerometer, so a vision frame that does not point up or whose
attitude is wrong does what it does on the real vehicle.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from tombo_control.autopilot import HISTORY_TICKS, Autopilot, PoseAtTick
from tombo_control.estimator import correct
from tombo_control.tick_calls import predict, store_history, update_body_rates
from tombo_dynamics.arrays import Array
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import up_in_body, yaw_of
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.frames import quaternion_of_angles
from tombo_sim.simulator import Simulator

_ALIGN_TICKS = 200
"""Samples of the accelerometer that the first attitude is levelled with."""
_GPS_TICKS = 50
_GPS_FIRST = 10
"""So many fixes are waited for before they are believed."""
_COMPASS_NOISE = 0.01
"""[rad]."""
_UNIT = 1e-5
"""The length of a quaternion may differ from 1 by this."""
_GPS_NOISE = 0.02
"""[m], of an RTK receiver."""
_BARO_NOISE = 0.03
"""[m]."""
_BARO_BANDWIDTH = 0.7
"""[rad/s], of the height where the poses are lost."""
_GPS_BANDWIDTH = 3.0
"""[rad/s]: a fix is noisier than a pose of the motion capture."""
_FUTURE_US = 5_000
_FARTHEST = 1e5
"""[m]: a farther pose is a mistake."""
_RESET_TICKS = TICK_HZ
"""Refused for so long, samples are believed: EKF2 resets after 1 s (`no_aid_timeout_max`)."""
_GAP_TICKS = 250
"""Vision that was away for longer begins again."""
_STALE_TICKS = TICK_HZ
"""Vision that is this old does not keep GPS out any more."""
_HEIGHT_STAYS_TICKS = 500
"""So much later than the position PX4 1.17 gave up a height that no barometer supports."""
_FLIGHT_TILT, _GROUND_TILT = 0.1, 0.5
"""Share of the tilt error seen by the accelerometer that goes into the correction."""
_LEVEL_VARIANCE, _YAW_VARIANCE, _RATE_VARIANCE = 1e-4, 1e-4, 1e-4
_SLOW_BIAS = 0.1
"""Share of the correction of the gyro's roll and pitch bias that is kept in flight."""


class _Fix(NamedTuple):
    captured: int
    arrives: int
    position: Array
    yaw: float


class Ekf2Model:
    """Estimate of attitude, position and velocity, in the autopilot's memory."""

    def __init__(
        self, autopilot: Autopilot, simulator: Simulator, parameters: ParameterTable, seed: int
    ) -> None:
        self._autopilot = autopilot
        self._autopilots = autopilot.as_array()
        self._parameters = parameters
        self._rng = np.random.default_rng([seed, 0x6750])
        self._vision_bandwidth = float(autopilot.observer.position_bandwidth)
        self._level = np.zeros(3)
        self._samples = 0
        self._gps: deque[_Fix] = deque()
        self._height = self._compass = math.nan
        self._fixes = 0
        self._vision: deque[_Fix] = deque(maxlen=64)
        self._state_history: deque[_Fix] = deque(maxlen=8)
        self._newest_vision = -1
        self._last_vision = -(10**9)
        self.fused_tick = -(10**9)
        """When a sample was last used."""
        self._last_captured = -1
        self._refused_since = -1
        self.source = ""
        """What the position comes from: `vision`, `gps` or "" for nothing."""
        self.attitude_ok = False
        self.resets = 0
        """How often position and yaw have jumped to a source."""
        autopilot.state.position = 0.0

    def local_ok(self, tick: int) -> bool:
        """Return whether the position in map is known."""
        limit = self._parameters.get("EKF2_NOAID_TOUT") * 1e-3
        return bool(self.source) and tick - self.fused_tick <= limit

    def altitude_ok(self, tick: int) -> bool:
        """Return whether the height is known: a barometer keeps it where the poses are lost."""
        barometer = self._parameters.get("SYS_HAS_BARO") and self._parameters.get("EKF2_BARO_CTRL")
        limit = self._parameters.get("EKF2_NOAID_TOUT") * 1e-3 + _HEIGHT_STAYS_TICKS
        return bool(self.source) and bool(barometer or tick - self.fused_tick <= limit)

    def global_ok(self, tick: int) -> bool:
        """Return whether the position on earth is known."""
        return self.local_ok(tick) and self.source == "gps"

    def variances(self, tick: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return those of the pose and of the motion.

        (6) of x, y, z [m^2], roll, pitch, yaw [rad^2]; (6) of velocity [m^2/s^2] and rates
        [rad^2/s^2].
        """
        drift = (0.1 * min(max(tick - self.fused_tick, 0) * TICK_S, 60.0)) ** 2
        noise = 0.01 if self.source == "vision" else self._parameters.get("EKF2_GPS_P_NOISE")
        place, speed = noise**2 + drift, 0.02**2 + drift
        return (
            (place, place, place, _LEVEL_VARIANCE, _LEVEL_VARIANCE, _YAW_VARIANCE),
            (speed, speed, speed, _RATE_VARIANCE, _RATE_VARIANCE, _RATE_VARIANCE),
        )

    def vision(self, tick: int, boot_us: int, position: Array, attitude: Array) -> str:
        """Take a pose from outside; "" or why it is refused: see `Px4Vehicle.vision`."""
        if not (np.isfinite(position).all() and np.isfinite(attitude).all()):
            return "not_finite"
        if np.abs(position).max() > _FARTHEST:
            return "out_of_range"
        if boot_us > tick * 1000 + _FUTURE_US:
            return "future"
        delay = self._parameters.get("EKF2_EV_DELAY")
        captured = round(boot_us * 1e-3 - delay)
        if captured <= self._newest_vision:
            return "out_of_order"
        oldest = min(self._parameters.get("EKF2_DELAY_MAX"), HISTORY_TICKS - 2)
        if captured <= tick - oldest:
            return "late"
        if not int(self._parameters.get("EKF2_EV_CTRL")):
            return "not_fused"
        if captured - self._newest_vision > _GAP_TICKS:
            self._state_history.clear()
        self._newest_vision = captured
        unit = abs(math.sqrt(float(attitude @ attitude)) - 1.0) <= _UNIT
        yaw = yaw_of(attitude) if unit else math.nan  # PX4 drops the attitude, and says nothing
        self._vision.append(_Fix(captured, captured, position.copy(), yaw))
        return ""

    def sense(self, simulator: Simulator, airborne: bool) -> None:
        """Take the samples of the present tick, before the control loops run."""
        tick = simulator.tick
        store_history(self._autopilots, tick)
        if not airborne or not self.attitude_ok:
            self._update_tilt_reference(simulator.accel)
        if tick % _GPS_TICKS == 0:
            self._receive(simulator)
        while self._vision and self._vision[0].captured <= tick:
            self._take(self._vision.popleft(), "vision", tick, airborne)
        while self._gps and self._gps[0].arrives <= tick:
            fix = self._gps.popleft()
            if tick - self._last_vision > _STALE_TICKS:
                self._take(fix, "gps", tick, airborne)
        if airborne and tick - self.fused_tick > _STALE_TICKS and math.isfinite(self._height):
            self._fuse_height()
        update_body_rates(self._autopilots, simulator.gyro)

    def _fuse_height(self) -> None:
        """Correct height and climb by the barometer alone, a tick of 1 ms."""
        state = self._autopilot.state
        gap = self._height - float(state.position[2])
        state.position[2] += 2.0 * _BARO_BANDWIDTH * gap * TICK_S
        state.velocity[2] += _BARO_BANDWIDTH**2 * gap * TICK_S

    def advance(self, simulator: Simulator, airborne: bool) -> None:
        """Carry the estimate on to the next tick, after the control loops."""
        located = airborne and bool(self.source)
        predict(self._autopilots, simulator.accel, located)

    def _update_tilt_reference(self, force: Array) -> None:
        """Low-pass the specific force of a vehicle at rest; level the first attitude with it."""
        if not math.isfinite(float(force.sum())):
            return
        self._samples += 1
        self._level += (force - self._level) / min(self._samples, _ALIGN_TICKS)
        if self.attitude_ok or self._samples < _ALIGN_TICKS:
            return
        x, y, z = (float(v) for v in self._level)
        length = math.sqrt(x * x + y * y + z * z)
        if length < 0.5 * GRAVITY:
            return
        self._autopilot.state.attitude = _upright(x / length, y / length, z / length)
        self._clear_history()
        self.attitude_ok = True

    def _receive(self, simulator: Simulator) -> None:
        """Read barometer, compass and GPS, each with its own noise of where it really is."""
        get = self._parameters.get
        noise = self._rng.standard_normal(5)  # drawn in any case, for the same random sequence
        body = numbers(simulator.plant.state)
        baro = get("SYS_HAS_BARO") and get("EKF2_BARO_CTRL")
        compass = get("SYS_HAS_MAG") and get("EKF2_MAG_TYPE") != 5
        yaw = yaw_of(body[6:10]) + _COMPASS_NOISE * float(noise[3])
        self._height = float(body[2]) + _BARO_NOISE * float(noise[4]) if baro else math.nan
        self._compass = yaw if compass else math.nan
        if not (get("SYS_HAS_GPS") and int(get("EKF2_GPS_CTRL")) & 1 and compass):
            self._gps.clear()
            self._fixes = 0
            return
        position = body[:3] + _GPS_NOISE * noise[:3]
        tick = simulator.tick
        self._gps.append(_Fix(tick, tick + int(get("EKF2_GPS_DELAY")), position, yaw))

    def _take(self, fix: _Fix, source: str, tick: int, airborne: bool) -> None:
        if not self.attitude_ok:
            return
        get = self._parameters.get
        if source == "gps":
            self._fixes += 1
            if self._fixes < _GPS_FIRST:
                return
        control = int(get("EKF2_EV_CTRL")) if source == "vision" else 15
        if source == "vision":
            height = control & 2 or math.isfinite(self._height) or get("EKF2_HGT_REF") == 3
            if not control & 1 or not height:
                return
            self._state_history.append(fix)
        if source != self.source or not self.local_ok(tick):
            self._change_source(fix, source, tick, airborne)
            return
        past = self._past(fix.captured)
        if past.tick != fix.captured:
            return
        if self._is_far(fix, source, control, past, tick):
            if self._refused_since < 0:
                self._refused_since = tick
            elif tick - self._refused_since >= _RESET_TICKS:
                self._reset(fix, source, tick, airborne)
            return
        self._refused_since = -1
        self._fuse(fix, control, tick, airborne)
        if source == "vision":
            self._last_vision = tick

    def _past(self, tick: int) -> PoseAtTick:
        """Return the estimate of a tick, or of another that has its place in the history."""
        past: PoseAtTick = self._autopilot.history[tick % HISTORY_TICKS]
        return past

    def _is_far(self, fix: _Fix, source: str, control: int, past: PoseAtTick, tick: int) -> bool:
        """Return whether a sample is too far from the estimate of its time to be believed."""
        gap = fix.position - past.position
        if not control & 2 and self._parameters.get("EKF2_HGT_REF") != 3:
            gap[2] = 0.0
        since = min((tick - self.fused_tick) * TICK_S, 5.0)
        if float(np.abs(gap).max()) > self._innovation_gate(source) + 0.2 * since:
            return True
        if source != "vision" or not control & 8:
            return False
        turn = math.remainder(fix.yaw - yaw_of(past.attitude), 2.0 * math.pi)
        get = self._parameters.get
        return abs(turn) > get("EKF2_EVP_GATE") * get("EKF2_EVA_NOISE") + 0.1 * since

    def _innovation_gate(self, source: str) -> float:
        get = self._parameters.get
        if source == "gps":
            return max(5.0 * get("EKF2_GPS_P_NOISE"), 0.1) + 0.3
        return get("EKF2_EVP_GATE") * get("EKF2_EVP_NOISE")

    def _change_source(self, fix: _Fix, source: str, tick: int, airborne: bool) -> None:
        """Begin with a source: none is in use, or it was lost."""
        if source == "vision" and len(self._state_history) < 3:
            return
        self._reset(fix, source, tick, airborne)

    def _reset(self, fix: _Fix, source: str, tick: int, airborne: bool) -> None:
        """Let position and yaw jump to a sample."""
        autopilot = self._autopilot
        state = autopilot.state
        control = int(self._parameters.get("EKF2_EV_CTRL")) if source == "vision" else 15
        velocity: Array = np.zeros(3)
        if airborne and source == "vision" and len(self._state_history) > 1:
            first = self._state_history[0]
            time = max(fix.captured - first.captured, 1) * TICK_S
            velocity = np.clip((fix.position - first.position) / time, -10.0, 10.0)
        elif airborne and self.source:
            velocity = state.velocity.copy()
        late = (tick - fix.captured) * TICK_S
        state.position = fix.position + late * velocity
        state.velocity = velocity
        if not control & 2 and math.isfinite(self._height):
            state.position[2] = self._height
        yaw = fix.yaw if control & 8 and math.isfinite(fix.yaw) else self._compass
        if math.isfinite(yaw):
            _turn(state.attitude, yaw - yaw_of(state.attitude))
        self._clear_history()
        store_history(self._autopilots, tick)
        self.source = source
        self._refused_since = -1
        self.fused_tick = tick
        self._last_captured = fix.captured
        if source == "vision":
            self._last_vision = tick
        bandwidth = self._vision_bandwidth if source == "vision" else _GPS_BANDWIDTH
        autopilot.observer.position_bandwidth = bandwidth
        self.resets += 1

    def _clear_history(self) -> None:
        self._autopilot.history["tick"] = -1

    def _fuse(self, fix: _Fix, control: int, tick: int, airborne: bool) -> None:
        autopilot = self._autopilot
        state, past = autopilot.state, self._past(fix.captured)
        position, attitude = past.position.copy(), past.attitude.copy()
        position[:2] = fix.position[:2]
        if control & 2 or self._parameters.get("EKF2_HGT_REF") == 3:
            position[2] = fix.position[2]
        elif math.isfinite(self._height):
            position[2] += self._height - state.position[2]
        _lean(attitude, self._tilt_error(attitude, airborne))
        if control & 8 and math.isfinite(fix.yaw):
            _turn(attitude, fix.yaw - yaw_of(attitude))
        elif math.isfinite(self._compass):
            _turn(attitude, self._compass - yaw_of(state.attitude))
        bias = state.gyro_bias
        before = bias[:2].copy()
        period = (fix.captured - self._last_captured) * TICK_S
        if correct(autopilot, position, attitude, fix.captured, tick, period, airborne):
            if airborne:
                bias[:2] = before + _SLOW_BIAS * (bias[:2] - before)
            self._last_captured = fix.captured
            self.fused_tick = tick
            autopilot.mocap_time = fix.captured * TICK_S

    def _tilt_error(self, attitude: Array, airborne: bool) -> Array:
        """Return the turn (3), body frame, by which gravity says that the attitude is off."""
        up = up_in_body(attitude)
        if airborne:  # in flight a tilt error shows as a bias of the accelerometer
            bias: Array = self._autopilot.state.accel_bias
            return np.asarray(_FLIGHT_TILT / GRAVITY * np.cross(bias, up), float)
        return np.asarray(_GROUND_TILT * np.cross(self._level / GRAVITY, up), float)


def _upright(x: float, y: float, z: float) -> Array:
    """Return the attitude of yaw 0 in which body (x, y, z), of unit length, points up."""
    roll, pitch = math.atan2(y, z), math.asin(min(max(-x, -1.0), 1.0))
    w, *xyz = quaternion_of_angles(roll, pitch, 0.0)
    return np.array([*xyz, w])


def _turn(q: Array, yaw: float) -> None:
    """Turn a quaternion xyzw about map z, in place."""
    s, c = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    x, y, z, w = (float(v) for v in q)
    q[:] = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)


def _lean(q: Array, turn: Array) -> None:
    """Turn a quaternion xyzw by a small rotation vector in its own frame, in place."""
    x, y, z, w = (float(v) for v in q)
    a, b, c = (0.5 * float(v) for v in turn)
    q[:] = (
        x + w * a + y * c - z * b,
        y + w * b + z * a - x * c,
        z + w * c + x * b - y * a,
        w - x * a - y * b - z * c,
    )
    q /= math.sqrt(float(q @ q))
