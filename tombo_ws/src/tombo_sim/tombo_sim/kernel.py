"""The fused flight kernel: plant, sensors, estimator and cascade, tick by tick, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_control.autopilot import IDLE, LANDED, A
from tombo_control.cascade import cascade
from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_dynamics.effects.compose import apply_imu, apply_mocap
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P
from tombo_dynamics.rigid_body import begin_tick, finish_tick
from tombo_sim.log_columns import AT

_TICK = 1e-3

NEXT_CAPTURE, OLDEST_UNDELIVERED, LAST_CAPTURED = range(3)
"""Meaning of the kernel's integer state."""
STAMPED, ARRIVES, DELIVERED, POSE = 0, 1, 2, 3
"""Columns of the mocap table: capture as the stamp says it [ticks, with fraction], tick of arrival
(-1: dropped), 0/1, pose (7)."""
MOCAP_WIDTH = 10
_AHEAD = 5
"""Ticks that a stamp may be ahead of the clock; the pose then waits for its time."""


@compiled
def fly(
    m: Array,
    a: Array,
    maps: Array,
    theta: Array,
    tick_noise: Array,
    mocap_noise: Array,
    capture_ticks: NDArray[np.int64],
    mocap: Array,
    state: NDArray[np.int64],
    log: Array,
    base: int,
    start: int,
    stop: int,
) -> tuple[int, int]:
    """Fly from tick `start` until a mocap sample has been delivered or tick `stop` is reached.

    Args:
        m: memory of the plant, changed in place.
        a: memory of the autopilot, changed in place.
        maps: the rotor's table, `tombo_dynamics.rotor_maps`.
        theta: parameters of all effects.
        tick_noise: (B, 9) standard normals, a row a tick, the first for tick `base`.
        mocap_noise: (M, 9) standard normals, a row a sample.
        capture_ticks: (M,) ticks at which samples are captured.
        mocap: (M, 10) table of samples, filled here.
        state: (3,) see NEXT_CAPTURE.
        log: (N, LOG_WIDTH), a row is written for every tick.
        base: tick of the first row of `tick_noise`.
        start: first tick to fly.
        stop: first tick not to fly.

    Returns:
        the next tick to fly, and the row of the sample delivered in the last one (or -1).
    """
    for k in range(start, stop):
        noise = tick_noise[k - base]
        read_imu(m, maps, noise, theta)
        if k == capture_ticks[state[NEXT_CAPTURE]]:
            capture_pose(m, mocap_noise, theta, mocap, state, k)
        airborne = a[A.mode] != IDLE and a[A.mode] != LANDED
        store_history(a, k)
        row = deliver_pose(a, mocap, state, k, airborne)
        update_body_rates(a, m, P.imu)
        cascade(a, maps, k)
        for i in range(4):
            m[P.command + i] = a[A.command + i]
        write_row(m, a, log, k)
        predict(a, m, P.imu + 3, airborne)
        finish_tick(m, noise, theta)
        if row >= 0:
            return k + 1, row
    return stop, -1


@compiled
def fly_with_true_state(
    m: Array, a: Array, maps: Array, theta: Array, noise: Array, start: int, stop: int
) -> None:
    """Fly the plant and the cascade alone, the true state in place of the estimate; no log.

    The bare loop for benchmarks and for studies of many vehicles.
    """
    for k in range(start, stop):
        begin_tick(m, maps, noise, theta)
        for i in range(3):
            a[A.position + i] = m[P.body + i]
            a[A.velocity + i] = m[P.body + 3 + i]
            a[A.rates + i] = m[P.body + 10 + i]
        for i in range(4):
            a[A.attitude + i] = m[P.body + 6 + i]
        a[A.mode + 2] = k * _TICK
        cascade(a, maps, k)
        for i in range(4):
            m[P.command + i] = a[A.command + i]
        finish_tick(m, noise, theta)


@compiled
def read_imu(m: Array, maps: Array, noise: Array, theta: Array) -> None:
    """Begin the tick and read the IMU: body rates, and force without gravity over mass."""
    begin_tick(m, maps, noise, theta)
    for i in range(3):
        m[P.imu + i] = m[P.body + 10 + i]
        m[P.imu + 3 + i] = m[P.wrench + i] / m[P.inertial]
    apply_imu(m, noise, theta)


@compiled
def capture_pose(
    m: Array, mocap_noise: Array, theta: Array, mocap: Array, state: NDArray[np.int64], tick: int
) -> None:
    """Take a mocap sample of the true pose and enter it, with its time of arrival."""
    i = state[NEXT_CAPTURE]
    for j in range(3):
        m[P.mocap + j] = m[P.body + j]
    for j in range(4):
        m[P.mocap + 3 + j] = m[P.body + 6 + j]
    m[P.mocap + 7] = 0.0
    m[P.mocap + 8] = 0.0
    m[P.mocap + 10] = 0.0
    m[P.mocap + 9] = max(m[P.mocap + 9] - (tick - state[LAST_CAPTURED]) * m[P.clock + 1], 0.0)
    apply_mocap(m, mocap_noise[i], theta)
    mocap[i, STAMPED] = tick + m[P.mocap + 10] / m[P.clock + 1]
    mocap[i, DELIVERED] = 0.0
    mocap[i, ARRIVES] = -1.0
    if m[P.mocap + 8] == 0.0:
        mocap[i, ARRIVES] = tick + int(m[P.mocap + 7] / m[P.clock + 1] + 0.5)
    for j in range(7):
        mocap[i, POSE + j] = m[P.mocap + j]
    state[NEXT_CAPTURE] = i + 1
    state[LAST_CAPTURED] = tick


@compiled
def stamped_tick(mocap: Array, i: int) -> int:
    """Return the tick nearest to the stamp of sample `i`."""
    return math.floor(float(mocap[i, STAMPED]) + 0.5)


@compiled
def deliver_pose(
    a: Array, mocap: Array, state: NDArray[np.int64], tick: int, airborne: bool
) -> int:
    """Hand the estimator the sample that arrives in this tick; return its row, or -1.

    The estimator takes the stamp for the time of capture. It refuses one from the future, but lets
    one wait that is only a little ahead.
    """
    head = state[OLDEST_UNDELIVERED]
    end = state[NEXT_CAPTURE]
    while head < end and (mocap[head, ARRIVES] < 0.0 or mocap[head, DELIVERED] > 0.0):
        head += 1
    state[OLDEST_UNDELIVERED] = head
    for i in range(head, end):
        if mocap[i, DELIVERED] == 0.0 and 0.0 <= mocap[i, ARRIVES] <= tick:
            captured = stamped_tick(mocap, i)
            if tick < captured <= tick + _AHEAD:
                continue
            mocap[i, DELIVERED] = 1.0
            mocap[i, ARRIVES] = tick
            period = captured * _TICK - a[A.mode + 2]
            if correct(a, mocap[i], POSE, captured, tick, period, airborne):
                a[A.mode + 2] = max(a[A.mode + 2], captured * _TICK)
            return i
    return -1


@compiled
def write_row(m: Array, a: Array, log: Array, k: int) -> None:
    """Write the tick into row `k` of the log, in the columns of `log_columns.AT`."""
    r = P.rotation
    touching = m[P.contact]
    for i in range(3):
        log[k, AT.position + i] = m[P.body + i]
        log[k, AT.velocity + i] = m[P.body + 3 + i]
        log[k, AT.rates + i] = m[P.body + 10 + i]
        log[k, AT.contact + 2 + i] = m[P.contact + 5 + i]
        log[k, AT.gyro + i] = m[P.imu + i]
        log[k, AT.accel + i] = m[P.imu + 3 + i]
        log[k, AT.est_position + i] = a[A.position + i]
        log[k, AT.est_velocity + i] = a[A.velocity + i]
        log[k, AT.position_setpoint + i] = a[A.position_setpoint + i]
        log[k, AT.velocity_setpoint + i] = a[A.velocity_reference + i]
        log[k, AT.acceleration_setpoint + i] = a[A.acceleration_setpoint + i]
        log[k, AT.rates_setpoint + i] = a[A.rates_setpoint + i]
        log[k, AT.wind + i] = m[P.wind + i]
        log[k, AT.battery + i] = m[P.supply + i]
        push = 0.0
        if touching > 0.0:
            for j in range(3):
                push += m[r + 3 * i + j] * m[P.strike + j]
            if m[P.contact + 1] < 0.0:
                push += m[P.contact + 2 + i]
        log[k, AT.contact_force + i] = push
    for i in range(4):
        log[k, AT.attitude + i] = m[P.body + 6 + i]
        log[k, AT.rotor_speed + i] = m[P.speed + i]
        log[k, AT.rotor_thrust + i] = m[P.thrust + i]
        log[k, AT.fold + i] = m[P.fold + i]
        log[k, AT.damage + i] = m[P.damage + i]
        log[k, AT.est_attitude + i] = a[A.attitude + i]
        log[k, AT.attitude_setpoint + i] = a[A.attitude_setpoint + i]
        log[k, AT.rotor_command + i] = m[P.command + i]
    log[k, AT.contact] = touching
    log[k, AT.contact + 1] = m[P.contact + 1]
    log[k, AT.thrust_setpoint] = a[A.thrust_setpoint]
    log[k, AT.mode] = a[A.mode + 1]
