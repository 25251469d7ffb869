"""Descent by PX4's gyro and accelerometer alone, for a vehicle whose poses are wrong.

PX4's own landing, and its velocity, follow the poses. So the bridge commands attitude and thrust,
with the controller's descent without a position: it brakes, sinks, and takes the thrust away once
the vehicle no longer sinks.
"""

from __future__ import annotations

import numpy as np

from tombo_control.autopilot import EstimatedState, LoopMemory, Setpoint
from tombo_control.loops.position_control import begin_descent, descend
from tombo_control.params import POSITION_TICKS, ControlParams
from tombo_control.safety.params import SafetyParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.records import parameter_record
from tombo_dynamics.time_base import TICK_HZ, TICK_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.link.messages import throttle_of

PERIOD_NS = POSITION_TICKS * TICK_NS
"""Period of its set points: that of the position loop [ns]."""
_LEARNS_S = 0.3
"""Time in which the throttle that hovers is learnt [s]."""
_LEAST_FORCE = 0.5 * GRAVITY
"""Specific force below which the throttle that hovers is not learnt [m/s^2]."""
_HOVER_LOW, _HOVER_HIGH = 0.05, 0.9
"""Throttle of a vehicle that can fly at all [1]."""
_PROBE_NS = 7 * TICK_HZ * TICK_NS // 10
"""Time between two trials whether the ground carries the vehicle [ns]."""
_REST_RATE, _REST_FORCE = 0.5, 0.2 * GRAVITY
"""As in `tombo_control.safety.touchdown` [rad/s], [m/s^2]."""


class LevelDescent:
    """Descends; `step` runs at 50 Hz.

    Attributes:
        hover: throttle that hovers, 0 to 1; 0: not known yet.
        touched: the ground carries the vehicle: it shows gravity though its rotors give less.
    """

    def __init__(self, mass: float, safety: SafetyParams) -> None:
        """Make it, for a vehicle of a mass [kg]; loads the compiled code."""
        self._mass, self._safety = mass, safety
        self._gains = parameter_record(ControlParams())
        self._state, self._setpoint = EstimatedState.new(), Setpoint.new()
        self._loops = LoopMemory.new()
        self.hover = 0.0
        self.touched = False
        self._throttle = 0.0
        self._contact_s = 0.0
        self._stepped_ns: int | None = None
        self._probed_ns = 0
        self.step(0, np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), 0.5)
        self.end()

    @property
    def active(self) -> bool:
        """It is under way."""
        return self._stepped_ns is not None

    def end(self) -> None:
        """End the descent, or forget an old one."""
        self._stepped_ns, self.touched, self._contact_s = None, False, 0.0
        begin_descent(self._loops)

    def learn_hover(self, throttle: float, force: float, step_s: float) -> None:
        """Take the throttle that PX4 commands in flight, and the specific force along body z."""
        if self.active or throttle < _HOVER_LOW or force < _LEAST_FORCE:
            return
        hover = min(max(throttle * GRAVITY / force, _HOVER_LOW), _HOVER_HIGH)
        share = min(step_s / _LEARNS_S, 1.0) if self.hover else 1.0
        self.hover += share * (hover - self.hover)

    def feel(self, rates: Array, accel: Array, step_s: float) -> None:
        """Take rates (3) [rad/s] and specific force (3) [m/s^2], base_link: on the ground yet?"""
        if not self.active:
            return
        size = float(np.linalg.norm(accel))
        rests = abs(size - GRAVITY) < _REST_FORCE and float(np.linalg.norm(rates)) < _REST_RATE
        push = float(accel[2]) / GRAVITY - self._throttle / max(self.hover, _HOVER_LOW)
        carried = rests and push > self._safety.touchdown_push
        self._contact_s = self._contact_s + step_s if carried else 0.0
        self.touched = self.touched or self._contact_s > self._safety.touchdown_time

    def step(
        self, now_ns: int, attitude: Array, velocity: Array, hover: float
    ) -> tuple[Array, float] | None:
        """Return attitude (4) xyzw, map from base_link, and throttle 0 to 1; None: not due yet.

        Args:
            now_ns: the present.
            attitude: (4) xyzw of PX4, map from base_link.
            velocity: (3) in map, by the accelerometer [m/s].
            hover: throttle that hovers where none was learnt.
        """
        if self._stepped_ns is not None and now_ns - self._stepped_ns < PERIOD_NS:
            return None
        if self._stepped_ns is None:
            self._probed_ns = now_ns
        self._stepped_ns = now_ns
        self.hover = self.hover or hover
        state, loops = self._state, self._loops
        state.attitude, state.velocity = attitude, velocity
        if now_ns - self._probed_ns > _PROBE_NS and loops.thrust_cut == 0.0:
            # take thrust away: a vehicle in the air sinks faster at once, and gets it back
            self._probed_ns = now_ns
            loops.touched, loops.touch_speed = True, velocity[2]
        thrust_max = self._mass * GRAVITY / self.hover
        descend(state, self._setpoint, self._loops, self._gains, self._mass, thrust_max)
        self._throttle = throttle_of(float(self._setpoint.thrust), self._mass, self.hover)
        return np.array(self._setpoint.attitude), self._throttle
