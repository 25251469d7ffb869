"""Where the autopilot thinks it is: IMU with GPS or vision, as EKF2 would have it.

The same observer as in the rest of the suite, fed as EKF2 is: of a pose only position and yaw are
used, and tilt comes from gyro and accelerometer. A wrong vision frame therefore acts as on the
real vehicle.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from tombo_control.autopilot import HISTORY_TICKS, Autopilot, PoseAtTick
from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import taking_rows
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import quaternion_multiply, up_in_body, yaw_of
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.frames import quaternion_of_angles
from tombo_sim.simulator import Simulator

_store_history = taking_rows(store_history, 2)
_update_body_rates, _predict = taking_rows(update_body_rates, 1), taking_rows(predict, 1)

_ALIGN_TICKS = 200
"""Samples of the accelerometer that the first attitude is levelled with."""
_SLOW_TICKS = 50
"""Between two samples of barometer, compass and GPS."""
_GPS_DELAY_TICKS = 110
"""Age of a fix when it arrives."""
_COMPASS_NOISE, _BARO_NOISE, _GPS_NOISE = 0.01, 0.03, 0.02
"""[rad], [m], and [m] of an RTK receiver."""
_UNIT = 1e-5
"""The length of a quaternion may differ from 1 by this."""
_BARO_BANDWIDTH = 0.7
"""[rad/s], of the height where the poses are lost."""
_GPS_BANDWIDTH = 3.0
"""[rad/s]: a fix is noisier than a pose of the motion capture."""
_VISION, _GPS = "vision", "gps"
_NOISE = {_VISION: 0.01, _GPS: 0.5}
"""[m], deviation that a source is taken to have, once it is fused."""
_GATE = {_VISION: (0.5, 0.5), _GPS: (2.8, math.inf)}
"""[m], [rad]: samples further off are refused; five of EKF2's deviations, and a margin for GPS."""
_FUSED = 1 | 2 | 8
"""Bits of EKF2_EV_CTRL: position, height and yaw, which are fused together here."""
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
_SLOW_BIAS = 0.1
"""Share of the correction of the gyro's roll and pitch bias that is kept in flight."""


class _Sample(NamedTuple):
    source: str
    captured: int
    arrives: int
    position: Array
    yaw: float
    """NaN: unknown."""


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
        self._level_samples = 0
        self._height = math.nan
        """Of the barometer [m]."""
        self._waiting: deque[_Sample] = deque(maxlen=64)
        self._recent: deque[_Sample] = deque(maxlen=8)
        """Poses, for the velocity where vision begins in flight."""
        self._newest_vision = -1
        self._vision_tick = -(10**9)
        self.fused_tick = -(10**9)
        """When a sample was last used."""
        self._last_captured = -1
        self._refused_since = -1
        self.source = ""
        """Source of the position: `vision`, `gps` or "" for nothing."""
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
        return self.local_ok(tick) and self.source == _GPS

    def variances(self, tick: int) -> tuple[float, float]:
        """Return those of an axis of the position [m^2] and of the velocity [m^2/s^2]."""
        drift = (0.1 * min(max(tick - self.fused_tick, 0) * TICK_S, 60.0)) ** 2
        return _NOISE.get(self.source, _NOISE[_GPS]) ** 2 + drift, 0.02**2 + drift

    def vision(self, tick: int, boot_us: int, position: Array, attitude: Array) -> str:
        """Take a pose from outside; "" or why it is refused: see `Px4Vehicle.vision`."""
        get = self._parameters.get
        if not (np.isfinite(position).all() and np.isfinite(attitude).all()):
            return "not_finite"
        if np.abs(position).max() > _FARTHEST:
            return "out_of_range"
        if boot_us > tick * 1000 + _FUTURE_US:
            return "future"
        captured = round(boot_us * 1e-3 - get("EKF2_EV_DELAY"))
        if captured <= self._newest_vision:
            return "out_of_order"
        if captured <= tick - min(get("EKF2_DELAY_MAX"), HISTORY_TICKS - 2):
            return "late"
        if int(get("EKF2_EV_CTRL")) & _FUSED != _FUSED:
            return "not_fused"
        if captured - self._newest_vision > _GAP_TICKS:
            self._recent.clear()
        self._newest_vision = captured
        unit = abs(math.sqrt(float(attitude @ attitude)) - 1.0) <= _UNIT
        yaw = yaw_of(attitude) if unit else math.nan  # PX4 drops the attitude, and says nothing
        self._waiting.append(_Sample(_VISION, captured, captured, position.copy(), yaw))
        return ""

    def sense(self, simulator: Simulator, airborne: bool) -> None:
        """Take the samples of the present tick, before the control loops run."""
        tick = simulator.tick
        _store_history(self._autopilots["state"], self._autopilots["history"], tick)
        if not airborne or not self.attitude_ok:
            self._update_tilt_reference(simulator.accel)
        if tick % _SLOW_TICKS == 0:
            self._read_slow_sensors(simulator)
        for sample in [s for s in self._waiting if s.arrives <= tick]:
            self._waiting.remove(sample)
            self._take(sample, tick, airborne)
        if airborne and tick - self.fused_tick > _STALE_TICKS and math.isfinite(self._height):
            self._fuse_height()
        _update_body_rates(self._autopilots["state"], simulator.gyro)

    def advance(self, simulator: Simulator, airborne: bool) -> None:
        """Carry the estimate on to the next tick, after the control loops."""
        _predict(self._autopilots["state"], simulator.accel, airborne and bool(self.source))

    def _fuse_height(self) -> None:
        """Correct height and climb by the barometer alone, a tick of 1 ms."""
        state = self._autopilot.state
        gap = self._height - float(state.position[2])
        state.position[2] += 2.0 * _BARO_BANDWIDTH * gap * TICK_S
        state.velocity[2] += _BARO_BANDWIDTH**2 * gap * TICK_S

    def _update_tilt_reference(self, force: Array) -> None:
        """Low-pass the specific force of a vehicle at rest; level the first attitude with it."""
        if not math.isfinite(float(force.sum())):
            return
        self._level_samples += 1
        self._level += (force - self._level) / min(self._level_samples, _ALIGN_TICKS)
        length = float(np.linalg.norm(self._level))
        aligned = self._level_samples >= _ALIGN_TICKS and length >= 0.5 * GRAVITY
        if self.attitude_ok or not aligned:
            return
        x, y, z = (self._level / length).tolist()
        w, *xyz = quaternion_of_angles(math.atan2(y, z), math.asin(min(max(-x, -1.0), 1.0)), 0.0)
        self._autopilot.state.attitude = [*xyz, w]
        self._autopilot.history["tick"] = -1
        self.attitude_ok = True

    def _read_slow_sensors(self, simulator: Simulator) -> None:
        """Read barometer and GPS with compass, each with its own noise of where it really is."""
        get = self._parameters.get
        noise = self._rng.standard_normal(5)  # drawn in any case, for the same random sequence
        body = numbers(simulator.plant.state)
        baro = get("SYS_HAS_BARO") and get("EKF2_BARO_CTRL")
        self._height = float(body[2]) + _BARO_NOISE * float(noise[4]) if baro else math.nan
        compass = get("SYS_HAS_MAG") and get("EKF2_MAG_TYPE") != 5
        if get("SYS_HAS_GPS") and int(get("EKF2_GPS_CTRL")) & 1 and compass:
            tick, position = simulator.tick, body[:3] + _GPS_NOISE * noise[:3]
            yaw = yaw_of(body[6:10]) + _COMPASS_NOISE * float(noise[3])
            sample = _Sample(_GPS, tick, tick + _GPS_DELAY_TICKS, position, yaw)
            self._waiting.append(sample)

    def _take(self, sample: _Sample, tick: int, airborne: bool) -> None:
        """Fuse a sample, or begin with its source; refuse what is far from the estimate."""
        by_vision = sample.source == _VISION
        stale = tick - self._vision_tick > _STALE_TICKS
        if not self.attitude_ok or not (by_vision or stale):
            return
        if by_vision:
            self._recent.append(sample)
        if sample.source != self.source or not self.local_ok(tick):  # or the source was lost
            if not by_vision or len(self._recent) >= 3:
                self._reset(sample, tick, airborne)
            return
        past: PoseAtTick = self._autopilot.history[sample.captured % HISTORY_TICKS]
        if past.tick != sample.captured:
            return
        if self._is_far(sample, past, tick):
            if self._refused_since < 0:
                self._refused_since = tick
            elif tick - self._refused_since >= _RESET_TICKS:
                self._reset(sample, tick, airborne)
            return
        self._refused_since = -1
        self._fuse(sample, past, tick, airborne)
        if by_vision:
            self._vision_tick = tick

    def _is_far(self, sample: _Sample, past: PoseAtTick, tick: int) -> bool:
        """Return whether a sample is too far from the estimate of its time to be believed."""
        since = min((tick - self.fused_tick) * TICK_S, 5.0)
        metres, radians = _GATE[sample.source]
        gap = float(np.abs(sample.position - past.position).max())
        turn = abs(math.remainder(sample.yaw - yaw_of(past.attitude), 2.0 * math.pi))
        return gap > metres + 0.2 * since or turn > radians + 0.1 * since

    def _reset(self, sample: _Sample, tick: int, airborne: bool) -> None:
        """Let position and yaw jump to a sample."""
        autopilot = self._autopilot
        state = autopilot.state
        by_vision = sample.source == _VISION
        velocity: Array = np.zeros(3)
        if airborne and by_vision and len(self._recent) > 1:
            first = self._recent[0]
            time = max(sample.captured - first.captured, 1) * TICK_S
            velocity = np.clip((sample.position - first.position) / time, -10.0, 10.0)
        elif airborne and self.source:
            velocity = state.velocity.copy()
        state.position = sample.position + (tick - sample.captured) * TICK_S * velocity
        state.velocity = velocity
        if math.isfinite(sample.yaw):
            state.attitude = _with_yaw(state.attitude, sample.yaw)
        autopilot.history["tick"] = -1
        _store_history(self._autopilots["state"], self._autopilots["history"], tick)
        self.source = sample.source
        self._refused_since = -1
        self.fused_tick = tick
        self._last_captured = sample.captured
        if by_vision:
            self._vision_tick = tick
        bandwidth = self._vision_bandwidth if by_vision else _GPS_BANDWIDTH
        autopilot.observer.position_bandwidth = bandwidth
        self.resets += 1

    def _fuse(self, sample: _Sample, past: PoseAtTick, tick: int, airborne: bool) -> None:
        """Correct the estimate; the tilt is gravity's, not the sample's."""
        autopilot = self._autopilot
        half = np.append(0.5 * self._tilt_error(past.attitude, airborne), 1.0)
        attitude = quaternion_multiply(past.attitude, half / np.linalg.norm(half))
        if math.isfinite(sample.yaw):
            attitude = _with_yaw(attitude, sample.yaw)
        bias = autopilot.state.gyro_bias
        before = bias[:2].copy()
        captured = sample.captured
        period = (captured - self._last_captured) * TICK_S
        if correct(autopilot, sample.position, attitude, captured, tick, period, airborne):
            if airborne:
                bias[:2] = before + _SLOW_BIAS * (bias[:2] - before)
            self._last_captured = captured
            self.fused_tick = tick
            autopilot.mocap_time = captured * TICK_S

    def _tilt_error(self, attitude: Array, airborne: bool) -> Array:
        """Return the turn (3), body frame, by which gravity says that the attitude is off."""
        up = up_in_body(attitude)
        if airborne:  # in flight a tilt error shows as a bias of the accelerometer
            bias: Array = self._autopilot.state.accel_bias
            return np.asarray(_FLIGHT_TILT / GRAVITY * np.cross(bias, up), float)
        return np.asarray(_GROUND_TILT * np.cross(self._level / GRAVITY, up), float)


def _with_yaw(attitude: Array, yaw: float) -> Array:
    """Return an attitude xyzw turned about map z to a yaw."""
    half = 0.5 * (yaw - yaw_of(attitude))
    return quaternion_multiply(np.array([0.0, 0.0, math.sin(half), math.cos(half)]), attitude)
