"""Flights of one vehicle, side by side: course, controller, air, battery and motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from tombo_benchmarks.diagnosis.second_simulator.airframe import Airframe, Numbers
from tombo_benchmarks.diagnosis.second_simulator.controller import Tracker
from tombo_benchmarks.diagnosis.second_simulator.courses import course
from tombo_benchmarks.diagnosis.second_simulator.hidden import Hidden
from tombo_benchmarks.diagnosis.second_simulator.strangers import Stranger
from tombo_benchmarks.diagnosis.second_simulator.vehicles import Array, Quadrotor

STEP_S = 0.004
"""Of the integration and of the controller."""
_CONTROL_NOISE = 0.005
"""rad/s, of the rates that the controller uses."""
_SETTLING_S = 2.0
"""Hover before the log begins."""
_EFFICIENCY = 0.7
"""Of the drives."""
_MAX_LEAN, _LOWEST, _FURTHEST = 1.3, 0.08, 6.0
"""rad, m, m: beyond this a flight counts as lost."""


class LostError(Exception):
    """The vehicle did not stay in the air: that needs no diagnosis."""


@dataclass(frozen=True)
class Flown:
    """What truly happened; (N, F, ...) for N steps of F flights."""

    t: Array
    """(N,) s"""
    position: Array
    velocity: Array
    attitude: Array
    """wxyz"""
    rates: Array
    turning: Array
    """rad/s^2"""
    felt: Array
    """m/s^2, specific force at the centre of mass"""
    rotor: Array
    """rad/s"""
    command: Array
    """rad/s"""
    electric: Array
    """(N, F, 2) V and A"""


def fly(
    quad: Quadrotor,
    hidden: Hidden,
    stranger: Stranger,
    kinds: Sequence[str],
    seconds: float,
    rng: np.random.Generator,
) -> Flown:
    """Fly courses of these kinds, one flight each.

    Raises:
        LostError: with what is hidden the vehicle can't fly them.
    """
    begin, steps = (round(x / STEP_S) for x in (_SETTLING_S, _SETTLING_S + seconds))
    flights = []
    for kind in kinds:
        path = course(kind, _times(steps - begin), rng)
        goal = np.column_stack([path.position, path.velocity, path.acceleration, path.yaw])
        goal = np.vstack([np.repeat(goal[:1], begin, axis=0), goal])
        air = _wind(quad, hidden, steps, rng)
        flights.append(_fly_one(quad, hidden, replace(stranger), goal, air, rng))
    rows = np.stack(flights, axis=1)[begin:]
    _refuse_lost(rows)
    parts = np.split(rows, np.cumsum([3, 3, 4, 3, 4, 6, 4]), axis=2)
    place, pace, attitude, rates, rotor, felt, command, electric = parts
    return Flown(
        _times(steps - begin), place, pace, attitude, rates, felt[..., 3:],
        felt[..., :3], rotor, command, electric,
    )  # fmt: skip


def _times(count: int) -> Array:
    return np.arange(count, dtype=np.float64) * STEP_S


def _fly_one(
    quad: Quadrotor,
    hidden: Hidden,
    stranger: Stranger,
    goals: Array,
    air: Array,
    rng: np.random.Generator,
) -> Array:
    """Return one flight (N, 29): state without load, felt, command, electric."""
    frame, pilot = Airframe(quad, hidden, stranger), Tracker(quad, STEP_S)
    noise = _CONTROL_NOISE * rng.standard_normal((len(goals), 3))
    battery = _Battery(quad, hidden)
    delay = hidden["command_delay.delay"] / STEP_S
    state = frame.at_rest(goals[0, :3].tolist())
    commands: list[Numbers] = []
    rows = []
    stuck = stranger.name == "thrust_hysteresis"
    for k, (goal, wind, shake) in enumerate(
        zip(goals.tolist(), air.tolist(), noise.tolist(), strict=True)
    ):
        rates = [a + b for a, b in zip(state[10:13], shake, strict=True)]
        commands.append(pilot.speeds(state, rates, goal))
        share = battery.share(frame.gain, state[13:17])
        target = [share * x for x in _delayed(commands, delay)]
        new = frame.step(state, target, wind, k * STEP_S, STEP_S)
        rows.append([*state[:17], *frame.felt, *commands[-1], *battery.electric])
        state = new
        if stuck:
            stranger.follow(sum(frame.rotor_forces(state, 0.0, 0.0)[0]))
        if not abs(state[2]) < _FURTHEST:
            raise LostError(f"at {k * STEP_S:.1f} s")
    return np.array(rows)


class _Battery:
    """Terminal voltage and current; what the drives can still reach of a commanded speed."""

    def __init__(self, quad: Quadrotor, hidden: Hidden) -> None:
        self._quad = quad
        self._resistance = hidden["battery_sag.resistance"]
        self._discharge = hidden["battery_sag.discharge"]
        self._used = 0.0
        self.electric = quad.battery, 0.0

    def share(self, gains: Numbers, speeds: Numbers) -> float:
        """Return the share of the commanded speed that is reached, and note V and A."""
        torques = [self._quad.thrust_and_torque(n)[1] for n in speeds]
        power = sum(g * m * n for g, m, n in zip(gains, torques, speeds, strict=True))
        current = power / (_EFFICIENCY * self.electric[0])
        self._used += current * STEP_S / 3600.0
        full = self._quad.battery
        voltage = full - self._resistance * current - self._discharge * self._used
        self.electric = voltage, current
        return voltage / full


def _wind(quad: Quadrotor, hidden: Hidden, steps: int, rng: np.random.Generator) -> Array:
    """Return the air's velocity (N, 3) [m/s]: steady, with a first-order random part."""
    decay = float(np.exp(-STEP_S / 1.0))
    drive = rng.standard_normal((steps, 3)) * np.sqrt(1.0 - decay**2)
    drive[0] /= np.sqrt(1.0 - decay**2)
    air = lfilter([1.0], [1.0, -decay], drive, axis=0)
    steady = np.array([hidden["steady_wind.east"], hidden["steady_wind.north"], 0.0])
    deviation = max(quad.air_motion + hidden["gusts.deviation"], 0.0)
    return np.asarray(deviation * air + steady)


def _delayed(commands: list[Numbers], delay: float) -> Numbers:
    """Return the command of `delay` steps ago, between steps interpolated."""
    whole = int(delay)
    part, last = delay - whole, len(commands) - 1
    near, far = commands[max(last - whole, 0)], commands[max(last - whole - 1, 0)]
    return [(1.0 - part) * a + part * b for a, b in zip(near, far, strict=True)]


def _refuse_lost(state: Array) -> None:
    x, y = state[..., 7], state[..., 8]
    lean = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
    bad = (
        not np.isfinite(state).all()
        or float(lean.max()) > _MAX_LEAN
        or float(state[..., 2].min()) < _LOWEST
        or float(np.abs(state[..., :3]).max()) > _FURTHEST
    )
    if bad:
        raise LostError(
            f"lean up to {lean.max():.2f} rad, height from {state[..., 2].min():.2f} m"
        )
