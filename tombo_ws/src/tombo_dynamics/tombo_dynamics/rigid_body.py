"""Newton-Euler equations of the quadrotor and their integration, one tick at a time."""

from __future__ import annotations

import math

from tombo_dynamics.disturbance import disturb, prepare_disturbance
from tombo_dynamics.effects.compose import (
    apply_air,
    apply_body,
    apply_command,
    apply_rotor,
    apply_wrench,
)
from tombo_dynamics.ground_contact import ground_clearance, ground_contact
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import DELAY_TICKS, SLOPES, Array, P, V
from tombo_dynamics.rotation import normalize_quaternion, rotation_matrix
from tombo_dynamics.rotors import advance_rotor_speeds, rotor_wrench
from tombo_dynamics.vehicle import GRAVITY

_START, _SLOPE = P.work, P.work + 26
"""Scratch of the integrator, beside `SLOPES`, which becomes the weighted sum of all slopes."""


@compiled
def derivative(m: Array, noise: Array, theta: Array, row: int, out: int) -> None:
    """Write d(body)/dt (13) of the state in `P.body` into `m[out:]`.

    Euler's equation holds the rotors' spin momentum; its change reacts through `rotor_wrench`.
    `row` picks the rotors' state at start (0), middle (1) or end (2) of the tick. The wrench that
    was used is left in `P.wrench`.
    """
    b = P.body
    r = P.rotation
    f = P.wrench
    s = P.strike
    rotors = P.rotors + 5 * row
    if row > 0:  # at the start of the tick it is there already
        rotation_matrix(m[b + 6 : b + 10], m[r : r + 9].reshape(3, 3))
    ax = m[b + 3] - m[P.wind]
    ay = m[b + 4] - m[P.wind + 1]
    az = m[b + 5] - m[P.wind + 2]
    m[P.flow] = m[r] * ax + m[r + 3] * ay + m[r + 6] * az
    m[P.flow + 1] = m[r + 1] * ax + m[r + 4] * ay + m[r + 7] * az
    m[P.flow + 2] = m[r + 2] * ax + m[r + 5] * ay + m[r + 8] * az
    wx, wy, wz = m[b + 10], m[b + 11], m[b + 12]
    spin = m[rotors + 4]
    m[f] = m[s]
    m[f + 1] = m[s + 1]
    m[f + 2] = m[s + 2] + m[rotors]
    m[f + 3] = m[s + 3] + m[rotors + 1] - wy * spin
    m[f + 4] = m[s + 4] + m[rotors + 2] + wx * spin
    m[f + 5] = m[s + 5] + m[rotors + 3]
    apply_wrench(m, noise, theta)
    if m[P.disturbance] != 0.0:
        disturb(m, row)
    if m[b + 2] < m[P.inertial + 14]:
        ground_contact(m)
    per_mass = m[P.inertial + 10]
    fx, fy, fz = m[f] * per_mass, m[f + 1] * per_mass, m[f + 2] * per_mass
    m[out] = m[b + 3]
    m[out + 1] = m[b + 4]
    m[out + 2] = m[b + 5]
    m[out + 3] = m[r] * fx + m[r + 1] * fy + m[r + 2] * fz
    m[out + 4] = m[r + 3] * fx + m[r + 4] * fy + m[r + 5] * fz
    m[out + 5] = m[r + 6] * fx + m[r + 7] * fy + m[r + 8] * fz - GRAVITY
    qx, qy, qz, qw = m[b + 6], m[b + 7], m[b + 8], m[b + 9]
    m[out + 6] = 0.5 * (qw * wx + qy * wz - qz * wy)
    m[out + 7] = 0.5 * (qw * wy + qz * wx - qx * wz)
    m[out + 8] = 0.5 * (qw * wz + qx * wy - qy * wx)
    m[out + 9] = -0.5 * (qx * wx + qy * wy + qz * wz)
    ix, iy, iz = m[P.inertial + 1], m[P.inertial + 2], m[P.inertial + 3]
    m[out + 10] = (m[f + 3] - (iz - iy) * wy * wz) * m[P.inertial + 11]
    m[out + 11] = (m[f + 4] - (ix - iz) * wz * wx) * m[P.inertial + 12]
    m[out + 12] = (m[f + 5] - (iy - ix) * wx * wy) * m[P.inertial + 13]


@compiled
def begin_tick(m: Array, maps: Array, noise: Array, theta: Array) -> None:
    """Settle what stays constant in the tick, and take the first slope of the integrator.

    Air, efficiencies, strikes and the targets of the drives. The command that acts is the one left
    by the tick before: one tick of transport.
    """
    rotation_matrix(m[P.body + 6 : P.body + 10], m[P.rotation : P.rotation + 9].reshape(3, 3))
    for i in range(3):
        m[P.wind + i] = 0.0
    for i in range(4):
        m[P.efficiency + i] = 1.0
        m[P.energy + i] = 0.0
    for i in range(6):
        m[P.strike + i] = 0.0
    m[P.contact] = 0.0
    apply_air(m, noise, theta)
    apply_rotor(m, noise, theta)
    slot = P.delay + 4 * (int(m[P.clock]) % DELAY_TICKS)
    for i in range(4):
        m[slot + i] = m[P.command + i]
        m[P.target + i] = m[P.command + i]
    apply_command(m, noise, theta)
    for i in range(4):
        m[P.target + i] *= 1.0 - m[P.fold + i]
    rotor_wrench(m, maps, 1.0, 0)
    rotor_wrench(m, maps, m[P.inertial + 8], 1)
    rotor_wrench(m, maps, m[P.inertial + 9], 2)
    if m[P.disturbance] != 0.0:
        prepare_disturbance(m)
    derivative(m, noise, theta, 0, SLOPES)


@compiled
def finish_tick(m: Array, noise: Array, theta: Array) -> None:
    """Integrate the rigid body over the tick (classical Runge-Kutta), after `begin_tick`.

    The rotors' speeds have a closed form (first-order lag) and enter exactly.
    """
    h = m[P.clock + 1]
    sixth = h * (1.0 / 6.0)
    for i in range(13):
        m[_START + i] = m[P.body + i]
        m[P.body + i] += 0.5 * h * m[SLOPES + i]
    derivative(m, noise, theta, 1, _SLOPE)
    for i in range(13):
        m[P.body + i] = m[_START + i] + 0.5 * h * m[_SLOPE + i]
        m[SLOPES + i] += 2.0 * m[_SLOPE + i]
    derivative(m, noise, theta, 1, _SLOPE)
    for i in range(13):
        m[P.body + i] = m[_START + i] + h * m[_SLOPE + i]
        m[SLOPES + i] += 2.0 * m[_SLOPE + i]
    derivative(m, noise, theta, 2, _SLOPE)
    for i in range(13):
        m[P.body + i] = m[_START + i] + sixth * (m[SLOPES + i] + m[_SLOPE + i])
    normalize_quaternion(m[P.body + 6 : P.body + 10])
    advance_rotor_speeds(m)
    m[P.clock] += 1.0


@compiled
def begin_flight(m: Array, noise: Array, theta: Array, tick: float) -> None:
    """Set true inertial parameters and the constants of the tick length `tick` [s]."""
    m[P.inertial] = m[V.mass]
    m[P.inertial + 1] = m[V.inertia_xx]
    m[P.inertial + 2] = m[V.inertia_yy]
    m[P.inertial + 3] = m[V.inertia_zz]
    m[P.inertial + 4] = m[V.motor_time_constant]
    for i in range(5, 8):
        m[P.inertial + i] = 0.0
    m[P.supply + 2] = m[V.battery_voltage]
    m[P.clock] = 0.0
    m[P.clock + 1] = tick
    apply_body(m, noise, theta)
    for i in range(4):
        m[P.inertial + 10 + i] = 1.0 / m[P.inertial + i]
    m[P.inertial + 14] = ground_clearance(m)
    m[P.inertial + 8] = math.exp(-0.5 * tick / m[P.inertial + 4])
    m[P.inertial + 9] = math.exp(-tick / m[P.inertial + 4])
