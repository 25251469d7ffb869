"""Newton-Euler equations of the quadrotor and their integration, one tick at a time."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
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
from tombo_dynamics.plant import DELAY_TICKS, Plant, State, add_slope
from tombo_dynamics.rotation import normalize_quaternion, rotation_matrix, to_body, to_map
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.rotors import advance_rotor_speeds, sum_rotors
from tombo_dynamics.vehicle import GRAVITY


@compiled
def derivative(plant: Plant, noise: Array, theta: Array, row: int, slope: State) -> None:
    """Write the derivative of `plant.state` into `slope`.

    Euler's equation holds the rotors' spin momentum; its change reacts through `sum_rotors`.
    `row` picks the rotors' state at start (0), middle (1) or end (2) of the tick. Also writes
    `airspeed`, and the wrench that was used: `force` and `moment`.
    """
    state, rotors, force, moment = plant.state, plant.rotors[row], plant.force, plant.moment
    turn = plant.rotation
    if row > 0:  # at the start of the tick it is there already
        rotation_matrix(state.attitude, turn)
    plant.airspeed[0], plant.airspeed[1], plant.airspeed[2] = to_body(
        turn,
        state.velocity[0] - plant.wind[0],
        state.velocity[1] - plant.wind[1],
        state.velocity[2] - plant.wind[2],
    )
    wx, wy, wz = state.rates[0], state.rates[1], state.rates[2]
    spin = rotors.spin_momentum
    force[0] = plant.strike_force[0]
    force[1] = plant.strike_force[1]
    force[2] = plant.strike_force[2] + rotors.thrust
    moment[0] = plant.strike_moment[0] + rotors.moment[0] - wy * spin
    moment[1] = plant.strike_moment[1] + rotors.moment[1] + wx * spin
    moment[2] = plant.strike_moment[2] + rotors.moment[2]
    apply_wrench(plant, noise, theta)
    if plant.disturbance.kind != 0:
        disturb(plant, row)
    if state.position[2] < plant.clear_height:
        ground_contact(plant)
    per_mass = plant.inverse_mass
    ax, ay, az = to_map(turn, force[0] * per_mass, force[1] * per_mass, force[2] * per_mass)
    slope.velocity[0] = ax
    slope.velocity[1] = ay
    slope.velocity[2] = az - GRAVITY
    slope.position = state.velocity
    q = state.attitude
    qx, qy, qz, qw = q[0], q[1], q[2], q[3]
    slope.attitude[0] = 0.5 * (qw * wx + qy * wz - qz * wy)
    slope.attitude[1] = 0.5 * (qw * wy + qz * wx - qx * wz)
    slope.attitude[2] = 0.5 * (qw * wz + qx * wy - qy * wx)
    slope.attitude[3] = -0.5 * (qx * wx + qy * wy + qz * wz)
    ix, iy, iz = plant.inertia[0], plant.inertia[1], plant.inertia[2]
    slope.rates[0] = (moment[0] - (iz - iy) * wy * wz) * plant.inverse_inertia[0]
    slope.rates[1] = (moment[1] - (ix - iz) * wz * wx) * plant.inverse_inertia[1]
    slope.rates[2] = (moment[2] - (iy - ix) * wx * wy) * plant.inverse_inertia[2]


@compiled
def begin_tick(plant: Plant, maps: RotorMaps, noise: Array, theta: Array) -> None:
    """Settle what stays constant in the tick, and take the first slope of the integrator.

    Air, efficiencies, strikes and the targets of the drives. The command that acts is the one left
    by the tick before: one tick of transport.
    """
    rotation_matrix(plant.state.attitude, plant.rotation)
    for i in range(3):
        plant.wind[i] = 0.0
        plant.strike_force[i] = 0.0
        plant.strike_moment[i] = 0.0
    for i in range(4):
        plant.efficiency[i] = 1.0
        plant.strike_energy[i] = 0.0
    plant.contact.touching = False
    apply_air(plant, noise, theta)
    apply_rotor(plant, noise, theta)
    newest = plant.past_commands[plant.ticks % DELAY_TICKS]
    plant.rotor_target = plant.rotor_command
    for i in range(4):
        newest[i] = plant.rotor_command[i]
    apply_command(plant, noise, theta)
    for i in range(4):
        plant.rotor_target[i] *= 1.0 - plant.fold[i]
    sum_rotors(plant, maps, 1.0, 0)
    sum_rotors(plant, maps, plant.half_tick_decay, 1)
    sum_rotors(plant, maps, plant.tick_decay, 2)
    if plant.disturbance.kind != 0:
        prepare_disturbance(plant)
    derivative(plant, noise, theta, 0, plant.slope)


@compiled
def finish_tick(plant: Plant, noise: Array, theta: Array) -> None:
    """Integrate the rigid body over the tick (classical Runge-Kutta), after `begin_tick`.

    The rotors' speeds have a closed form (first-order lag) and enter exactly.
    """
    tick = plant.tick_length
    state, start, sum_of_slopes, slope = plant.state, plant.start, plant.slope, plant.stage_slope
    plant.start = state
    add_slope(state, start, sum_of_slopes, 0.5 * tick)
    derivative(plant, noise, theta, 1, slope)
    add_slope(state, start, slope, 0.5 * tick)
    add_slope(sum_of_slopes, sum_of_slopes, slope, 2.0)
    derivative(plant, noise, theta, 1, slope)
    add_slope(state, start, slope, tick)
    add_slope(sum_of_slopes, sum_of_slopes, slope, 2.0)
    derivative(plant, noise, theta, 2, slope)
    add_slope(sum_of_slopes, sum_of_slopes, slope, 1.0)
    add_slope(state, start, sum_of_slopes, tick * (1.0 / 6.0))
    normalize_quaternion(state.attitude)
    advance_rotor_speeds(plant)
    plant.ticks += 1


@compiled
def begin_flight(plant: Plant, noise: Array, theta: Array, tick: float) -> None:
    """Set true inertial parameters and the constants of the tick length `tick` [s]."""
    nominal = plant.vehicle
    plant.mass = nominal.mass
    plant.inertia[0] = nominal.inertia_xx
    plant.inertia[1] = nominal.inertia_yy
    plant.inertia[2] = nominal.inertia_zz
    plant.motor_time_constant = nominal.motor_time_constant
    for i in range(2):
        plant.centre_of_gravity[i] = 0.0
    plant.supply.voltage = nominal.battery_voltage
    plant.ticks = 0
    plant.tick_length = tick
    apply_body(plant, noise, theta)
    plant.inverse_mass = 1.0 / plant.mass
    for i in range(3):
        plant.inverse_inertia[i] = 1.0 / plant.inertia[i]
    plant.clear_height = ground_clearance(plant)
    plant.half_tick_decay = math.exp(-0.5 * tick / plant.motor_time_constant)
    plant.tick_decay = math.exp(-tick / plant.motor_time_constant)
