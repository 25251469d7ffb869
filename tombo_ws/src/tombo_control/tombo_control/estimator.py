"""Pose and velocity from gyro, accelerometer and a late mocap pose.

A fixed-gain observer: the IMU carries the state forward every millisecond. A mocap sample corrects
it at its time of capture, so latency costs no phase.

The controller gets an estimate 250 times a second and some milliseconds late. Between two of them
it carries attitude and position on with its own gyro (`propagate`): that takes the delay out of
the attitude loop, and keeps the vehicle level for some seconds when no estimate comes at all.
"""

from __future__ import annotations

import math

from tombo_control.autopilot import HISTORY_TICKS, Autopilot, EstimatedState
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import rotate_by_vector, rotated, rotated_back, rotation_vector
from tombo_dynamics.time_base import TICK_NS, TICK_S
from tombo_dynamics.vectors import (
    ZERO,
    AnyVector,
    add,
    add_scaled,
    all_finite,
    clamp,
    scale,
    store,
    subtract,
    vector,
)
from tombo_dynamics.vehicle import GRAVITY


@compiled
def nearest_tick(stamp_ns: int) -> int:
    """Return the tick of 1 ms nearest to a stamp."""
    return (stamp_ns + TICK_NS // 2) // TICK_NS


@compiled
def store_history(state: EstimatedState, history: Array, tick: int) -> None:
    """Enter the pose of `state` in `history`, as that of `tick`."""
    # first all is read: it is in registers still, and a copy of memory would wait for it
    past, q = history[tick % HISTORY_TICKS], state.attitude
    position, attitude = vector(state.position), (q[0], q[1], q[2], q[3])
    past.position = position
    past.attitude = attitude
    past.tick = tick


@compiled
def update_body_rates(state: EstimatedState, gyro: Array) -> None:
    """Set `state.rates`, which the cascade flies on: gyro (3) [rad/s] minus its bias.

    A reading that is not finite is left out; the last rate stands.
    """
    for i in range(3):
        if math.isfinite(gyro[i]):
            state.rates[i] = gyro[i] - state.gyro_bias[i]


@compiled
def predict(state: EstimatedState, force: Array, airborne: bool) -> None:
    """Carry `state` over one tick of 1 ms with its body rates and the specific force.

    With a force that is not finite the velocity is taken as constant over the tick.

    Args:
        state: its rates are up to date; position, velocity and attitude are written.
        force: (3) specific force [m/s^2], body frame.
        airborne: False holds the velocity at zero, as on the ground.
    """
    if airborne:
        turned = rotated(state.attitude, subtract(force, state.accel_bias))
        acceleration = subtract(turned, (0.0, 0.0, GRAVITY))
        if not all_finite(acceleration):
            acceleration = ZERO
        way = add_scaled(scale(TICK_S, state.velocity), 0.5 * TICK_S * TICK_S, acceleration)
        state.position = add(state.position, way)
        state.velocity = add_scaled(state.velocity, TICK_S, acceleration)
    else:
        state.velocity = ZERO
    rotate_by_vector(state.attitude, scale(TICK_S, state.rates))


@compiled
def observer_gains(bandwidth: float, period: float) -> tuple[float, float, float]:
    """Return gains on position, velocity and acceleration for three equal discrete poles.

    The critically damped alpha-beta-gamma filter: all poles at exp(-bandwidth * period)
    (Bar-Shalom, Estimation with Applications to Tracking and Navigation, 6.5).
    """
    pole = math.exp(-bandwidth * period)
    gap = 1.0 - pole
    return 1.0 - pole**3, 1.5 * gap * gap * (1.0 + pole) / period, gap**3 / (period * period)


@compiled
def attitude_gains(bandwidth: float, period: float) -> tuple[float, float]:
    """Return gains on attitude and gyro bias for two equal discrete poles."""
    pole = math.exp(-bandwidth * period)
    return 1.0 - pole * pole, (1.0 - pole) ** 2 / period


@compiled
def correction_step(period: float) -> float:
    """Return the time [s] that gains are computed for: at most 0.2 s, at least a tick."""
    return min(max(period, TICK_S), 0.2)


@compiled(inline=False)
def correct(
    autopilot: Autopilot,
    position: Array,
    attitude: Array,
    captured: int,
    now: int,
    period: float,
    airborne: bool,
) -> bool:
    """Correct the estimate by a pose that was captured at tick `captured` and is known at `now`.

    The present estimate must be in the history already (`store_history`).

    Args:
        autopilot: `state` and `history` are corrected, by the parameters in `observer`.
        position: (3) in map [m].
        attitude: (4) quaternion xyzw, map from body.
        captured: tick of capture.
        now: tick of arrival.
        period: time since the last sample [s]; at most 0.2 s is used.
        airborne: False keeps accelerometer bias and velocity untouched.

    Returns:
        False if the sample is from the future, from before the start, older than the history, or
        not finite.
    """
    state, history, observer = autopilot.state, autopilot.history, autopilot.observer
    past = history[captured % HISTORY_TICKS]
    if captured < 0 or captured > now or past.tick != captured:
        return False
    if not (all_finite(position) and all_finite(attitude) and math.isfinite(attitude[3])):
        return False
    step = correction_step(period)
    gain_p, gain_v, gain_b = observer_gains(observer.position_bandwidth, step)
    if not airborne:
        gain_v = 0.0
        gain_b = 0.0
    gain_q, gain_g = attitude_gains(observer.attitude_bandwidth, step)

    error = subtract(position, past.position)
    turn = rotation_vector(attitude, past.attitude)
    bias = add_scaled(state.accel_bias, -gain_b, rotated_back(state.attitude, error))
    state.velocity = add_scaled(state.velocity, gain_v, error)
    state.accel_bias = clamp(bias, observer.accel_bias_max)
    drift = add_scaled(state.gyro_bias, -gain_g, turn)
    state.gyro_bias = clamp(drift, observer.gyro_bias_max)
    # later samples are held against the history, so it has to know of this correction
    for tick in range(captured, now + 1):
        past = history[tick % HISTORY_TICKS]
        share = gain_p + gain_v * (tick - captured) * TICK_S
        past.position = add_scaled(past.position, share, error)
        rotate_by_vector(past.attitude, scale(gain_q, turn))
    present = history[now % HISTORY_TICKS]
    state.position = present.position
    state.attitude = present.attitude
    return True


@compiled
def process_imu(
    autopilot: Autopilot, gyro: Array, accel: Array, tick: int, steps: int, airborne: bool
) -> None:
    """Take the IMU sample of `tick` and carry the estimate on to `tick + steps`.

    More than one step bridges lost samples: the last one is taken to hold.

    Args:
        autopilot: `state` at `tick` and `history` are carried on.
        gyro: (3) [rad/s], body frame.
        accel: (3) specific force [m/s^2], body frame.
        tick: tick of the sample.
        steps: ticks to the next sample.
        airborne: as in `predict`.
    """
    update_body_rates(autopilot.state, gyro)
    for k in range(steps):
        predict(autopilot.state, accel, airborne)
        store_history(autopilot.state, autopilot.history, tick + k + 1)


@compiled
def propagate(state: EstimatedState, history: Array, tick: int, ticks: int) -> None:
    """Carry attitude and position over `ticks` ticks to `tick`, with rates and velocity held.

    Reads and writes `state`; each tick on the way is entered in `history`.
    """
    rates = state.rates
    for k in range(ticks):
        state.position = add_scaled(state.position, TICK_S, state.velocity)
        rotate_by_vector(state.attitude, scale(TICK_S, rates))
        store_history(state, history, tick - ticks + k + 1)


@compiled
def integrate_force(state: EstimatedState, accel: Array, ticks: int) -> bool:
    """Carry the velocity over `ticks` ticks with the specific force, less its bias.

    False: that is not finite, the velocity is no longer known.

    Args:
        state: velocity is written; attitude and `accel_bias` are used.
        accel: (3) specific force [m/s^2], body.
        ticks: since the last sample.
    """
    force = rotated(state.attitude, subtract(accel, state.accel_bias))
    if not all_finite(force):
        return False
    acceleration = subtract(force, (0.0, 0.0, GRAVITY))
    state.velocity = add_scaled(state.velocity, ticks * TICK_S, acceleration)
    return True


@compiled(inline=False)
def correct_with_estimate(
    state: EstimatedState,
    history: Array,
    position: Array,
    velocity: AnyVector,
    attitude: Array,
    captured: int,
    now: int,
) -> None:
    """Take an estimate that was true at tick `captured`; `now` is the present tick.

    Writes position, velocity and attitude of `state`, and turns what `history` has since then.

    Args:
        state: at tick `now`.
        history: of the autopilot.
        position: (3) [m], map.
        velocity: (3) [m/s], map.
        attitude: (4) quaternion xyzw, map from base_link.
        captured: tick of the estimate; older than the history: it is taken as it is.
        now: present tick.
    """
    late = (now - captured) * TICK_S
    store(state.velocity, velocity)
    store(state.position, add_scaled(position, late, velocity))
    past = history[captured % HISTORY_TICKS]
    if captured > now or past.tick != captured:
        store(state.attitude, attitude)
        if captured > now:  # it came before the gyro sample it was made from: turn it back
            rotate_by_vector(state.attitude, scale(late, state.rates))
        store_history(state, history, now)
        return
    turn = rotation_vector(attitude, past.attitude)
    for tick in range(captured, now + 1):  # the next estimate is held against the history too
        q = history[tick % HISTORY_TICKS].attitude
        rotate_by_vector(q, turn)
    present = history[now % HISTORY_TICKS]
    state.attitude = present.attitude
