"""The model along a measured flight: the motion is imposed, forces and readings are computed.

Each tick is the simulator's own (`begin_tick`, and the IMU's effects), but the state comes from
the measurement in place of the integrator. So what is compared with data is what is flown.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import apply_air, apply_imu, apply_mocap
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import ANGULAR_ACCELERATION, P
from tombo_dynamics.rigid_body import begin_flight, begin_tick, derivative
from tombo_dynamics.rotors import advance_rotor_speeds, rotor_wrench
from tombo_dynamics.vehicle import GRAVITY


class _Imposed(NamedTuple):
    """First column of each quantity that `run_along_motion` writes."""

    force: Any = 0
    """3: specific force without sensor errors, body [m/s^2]."""
    accel_error: Any = 3
    """3: what the accelerometer shows beyond it [m/s^2]."""
    gyro_error: Any = 6
    """3: what the gyro shows beyond the body rates [rad/s]."""
    turning: Any = 9
    """3: angular acceleration, body [rad/s^2]."""
    acceleration: Any = 12
    """3: acceleration in map [m/s^2]."""
    speed: Any = 15
    """4: rotor speeds that the drives would have [rad/s]."""
    voltage: Any = 19
    """1: supply [V]."""
    current: Any = 20
    """1: supply [A]."""


I = _Imposed()  # noqa: E741 - an index like P and V
IMPOSED_WIDTH = 21


@compiled
def run_along_motion(
    m: Array,
    maps: Array,
    theta: Array,
    noise: Array,
    tick: float,
    motion: Array,
    command: Array,
    speed: Array,
    out: Array,
) -> None:
    """Run the model along a motion.

    Args:
        m: memory of a fresh plant (`new_plant`), its draws set; changed.
        maps: the rotor's table.
        theta: parameters of all effects.
        noise: (K, 9) standard normals, used in turn (one row of zeros: no noise).
        tick: distance of the rows [s].
        motion: (N, 16) position, velocity (map), quaternion xyzw, body rates and their slopes.
        command: (N, 4) rotor speeds asked for, mean over the tick [rad/s].
        speed: (N, 8) measured rotor speeds [rad/s] and their slopes [rad/s^2], from which thrust
            and torque then come, or (0, 8): thrust follows from the drives.
        out: (N, 21), filled; columns as in `I`.
    """
    begin_flight(m, noise[0], theta, tick)
    m[P.inertial + 14] = -1e9  # on a measured motion the floor would push as hard as noise says
    measured = speed.shape[0] > 0
    for i in range(4):
        m[P.command + i] = command[0, i]
        m[P.speed + i] = command[0, i]
        if measured:
            m[P.speed + i] = speed[0, i]
    for j in range(4 * 64):
        m[P.delay + j] = command[0, j % 4]
    free = np.zeros(8)
    for k in range(motion.shape[0]):
        row = noise[k % noise.shape[0]]
        for j in range(13):
            m[P.body + j] = motion[k, j]
        for i in range(4):
            m[P.command + i] = command[k, i]
        begin_tick(m, maps, row, theta)
        for i in range(4):
            free[i] = m[P.speed + i]
            free[4 + i] = m[P.target + i]
            out[k, I.speed + i] = free[i]
        if measured:
            for i in range(4):
                m[P.speed + i] = speed[k, i]
                m[P.target + i] = speed[k, i] + m[P.inertial + 4] * speed[k, 4 + i]
            rotor_wrench(m, maps, 1.0, 0)
            derivative(m, row, theta, 0, P.work + 13)
        slopes = P.work + 13
        for i in range(3):
            f = m[P.wrench + i] / m[P.inertial]
            m[P.imu + i] = m[P.body + 10 + i]
            m[P.imu + 3 + i] = f
            out[k, I.force + i] = f
            out[k, I.acceleration + i] = m[slopes + 3 + i]
            out[k, I.turning + i] = m[slopes + 10 + i]
        for i in range(3):
            m[ANGULAR_ACCELERATION + i] = motion[k, 13 + i]
        apply_imu(m, row, theta)
        for i in range(3):
            out[k, I.gyro_error + i] = m[P.imu + i] - m[P.body + 10 + i]
            out[k, I.accel_error + i] = m[P.imu + 3 + i] - out[k, I.force + i]
        out[k, I.voltage] = m[P.supply + 2]
        out[k, I.current] = m[P.supply + 1]
        for i in range(4):
            m[P.speed + i] = free[i]
            m[P.target + i] = free[4 + i]
        advance_rotor_speeds(m)
        m[P.clock] += 1.0


@compiled
def simulate_mocap(m: Array, theta: Array, noise: Array, poses: Array, spacing: float) -> Array:
    """Return what motion capture makes of true poses.

    Args:
        m: memory of a plant; its mocap part is changed.
        theta: parameters of all effects.
        noise: (K, 9) standard normals, used in turn.
        poses: (N, 7) true position and quaternion.
        spacing: time between the samples [s].

    Returns:
        (N, 10): pose, latency [s], dropped (0/1), error of the stamp [s].
    """
    out = np.zeros((poses.shape[0], 10))
    m[P.mocap + 9] = 0.0
    for k in range(poses.shape[0]):
        for j in range(7):
            m[P.mocap + j] = poses[k, j]
        m[P.mocap + 7] = 0.0
        m[P.mocap + 8] = 0.0
        m[P.mocap + 9] = max(m[P.mocap + 9] - spacing, 0.0)
        m[P.mocap + 10] = 0.0
        apply_mocap(m, noise[k % noise.shape[0]], theta)
        for j in range(9):
            out[k, j] = m[P.mocap + j]
        out[k, 9] = m[P.mocap + 10]
    return out


@compiled
def simulate_imu_at_rest(m: Array, theta: Array, noise: Array, tick: float, out: Array) -> None:
    """Write what the IMU shows of a vehicle at rest: (N, 6) gyro and specific force.

    Args:
        m: memory of a plant.
        theta: parameters of all effects.
        noise: (N, 9) standard normals.
        tick: distance of the rows [s].
        out: (N, 6) [rad/s, m/s^2], filled.
    """
    for k in range(out.shape[0]):
        for i in range(6):
            m[P.imu + i] = 0.0
        m[P.imu + 5] = GRAVITY
        for j in range(39):
            m[P.work + j] = 0.0
        apply_imu(m, noise[k], theta)
        for i in range(6):
            out[k, i] = m[P.imu + i]


@compiled
def air(m: Array, theta: Array, noise: Array, tick: float, out: Array) -> None:
    """Write the air's velocity in map, (N, 3) [m/s], tick by tick."""
    m[P.clock + 1] = tick
    for k in range(out.shape[0]):
        for i in range(3):
            m[P.wind + i] = 0.0
        apply_air(m, noise[k], theta)
        for i in range(3):
            out[k, i] = m[P.wind + i]
