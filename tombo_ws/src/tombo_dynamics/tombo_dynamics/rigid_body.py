"""Newton-Euler equations of the quadrotor and their integration, one tick at a time."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import ground_clearance, ground_contact
from tombo_dynamics.disturbance import disturb, prepare_disturbance
from tombo_dynamics.effects.compose import (
    apply_air,
    apply_body,
    apply_command,
    apply_rotor,
    apply_wrench,
)
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import DELAY_TICKS, Plant, State, add_slope, copy_state
from tombo_dynamics.rotation import (
    normalize_quaternion,
    quaternion_slope,
    rotation_matrix,
    to_body,
    to_map,
)
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.rotors import advance_rotor_speeds, sum_rotors
from tombo_dynamics.vectors import ZERO, add, multiply, scale, store, subtract, vector
from tombo_dynamics.vehicle import GRAVITY


@compiled
def derivative(plant: Plant, noise: Array, theta: Array, row: int, slope: State) -> None:
    """Write the derivative of `plant.state` into `slope`.

    Euler's equation holds the rotors' spin momentum; its change reacts through `sum_rotors`.
    `row` picks the rotors' state at start (0), middle (1) or end (2) of the tick. Also writes
    `airspeed`, and the wrench that was used: `force` and `moment`.
    """
    state, rotors, turn, strike = (
        plant.state,
        plant.rotors[row],
        plant.rotation,
        plant.strike_force,
    )
    if row > 0:  # at the start of the tick it is there already
        rotation_matrix(state.attitude, turn)
    plant.airspeed = to_body(turn, subtract(state.velocity, plant.wind))
    wx, wy, wz = vector(state.rates)
    spin = rotors.spin_momentum
    plant.force = (strike[0], strike[1], strike[2] + rotors.thrust)
    mx, my, mz = add(plant.strike_moment, rotors.moment)
    plant.moment = (mx - wy * spin, my + wx * spin, mz)
    apply_wrench(plant, noise, theta)
    if plant.disturbance.kind != 0:
        disturb(plant, row)
    if state.position[2] < plant.clear_height:
        ground_contact(plant)
    ax, ay, az = to_map(turn, scale(plant.inverse_mass, plant.force))
    slope.velocity = (ax, ay, az - GRAVITY)
    slope.position = state.velocity
    slope.attitude = quaternion_slope(state.attitude, state.rates)
    ix, iy, iz = vector(plant.inertia)
    gyroscopic = ((iz - iy) * wy * wz, (ix - iz) * wz * wx, (iy - ix) * wx * wy)
    slope.rates = multiply(subtract(plant.moment, gyroscopic), plant.inverse_inertia)


@compiled
def begin_tick(plant: Plant, maps: RotorMaps, noise: Array, theta: Array) -> None:
    """Settle what stays constant in the tick, and take the first slope of the integrator.

    Air, efficiencies, strikes and the targets of the drives. The command that acts is the one left
    by the tick before: one tick of transport.
    """
    rotation_matrix(plant.state.attitude, plant.rotation)
    plant.wind = plant.strike_force = plant.strike_moment = ZERO
    plant.efficiency[:] = 1.0
    plant.strike_energy[:] = 0.0
    plant.contact.touching = False
    apply_air(plant, noise, theta)
    apply_rotor(plant, noise, theta)
    plant.rotor_target = plant.rotor_command
    store(plant.past_commands[plant.ticks % DELAY_TICKS], plant.rotor_command)
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
    copy_state(start, state)
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
    plant.inertia = (nominal.inertia_xx, nominal.inertia_yy, nominal.inertia_zz)
    plant.motor_time_constant = nominal.motor_time_constant
    plant.centre_of_gravity[:] = 0.0
    plant.supply.voltage = nominal.battery_voltage
    plant.ticks = 0
    plant.tick_length = tick
    apply_body(plant, noise, theta)
    plant.inverse_mass = 1.0 / plant.mass
    ix, iy, iz = vector(plant.inertia)
    plant.inverse_inertia = (1.0 / ix, 1.0 / iy, 1.0 / iz)
    plant.clear_height = ground_clearance(plant)
    plant.half_tick_decay = math.exp(-0.5 * tick / plant.motor_time_constant)
    plant.tick_decay = math.exp(-tick / plant.motor_time_constant)
