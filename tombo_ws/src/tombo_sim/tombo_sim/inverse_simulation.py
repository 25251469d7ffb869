"""The model along a measured flight: the motion is imposed, forces and readings are computed.

Each tick is the simulator's own (`begin_tick`, and the IMU's effects), but the state comes from
the measurement in place of the integrator. So what is compared with data is what is flown.
`open_loop` begins at measured states and flies on: how far is it off a second later?
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import EffectMemories, SimulatedPlant, apply_imu, apply_mocap
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import DELAY_TICKS, Plant, set_state
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import begin_flight, begin_tick, derivative, finish_tick
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.rotors import advance_rotor_speeds, impose_rotor_target, sum_rotors
from tombo_dynamics.vectors import ZERO, store, subtract
from tombo_dynamics.vehicle import GRAVITY
from tombo_sim.sensing import specific_force


class ImposedTick(Record):
    """What `run_along_motion` writes of a tick."""

    force = field("m/s^2", "specific force without sensor errors, body", 3)
    accel_error = field("m/s^2", "what the accelerometer shows beyond it", 3)
    gyro_error = field("rad/s", "what the gyro shows beyond the body rates", 3)
    angular_acceleration = field("rad/s^2", "body", 3)
    acceleration = field("m/s^2", "map", 3)
    rotor_speed = field("rad/s", "that the drives would have", 4)
    voltage = field("V", "of the supply", 1)
    current = field("A", "of the supply", 1)
    memories = field("", "what effects remember at the end of the tick", kind=EffectMemories)


@compiled
def run_along_motion(
    plant: SimulatedPlant,
    maps: RotorMaps,
    theta: Array,
    noise: Array,
    tick: float,
    motion: Array,
    command: Array,
    speed: Array,
    out: Any,
) -> None:
    """Run the model along a motion.

    Args:
        plant: a fresh one (`new_plant`), its draws set; changed.
        maps: the rotor's table.
        theta: parameters of all effects.
        noise: (K, 9) standard normals, used in turn (one row of zeros: no noise).
        tick: distance of the rows [s].
        motion: (N, 16) position, velocity (map), quaternion xyzw, body rates and their slopes.
        command: (N, 4) rotor speeds asked for, mean over the tick [rad/s].
        speed: (N, 8) measured rotor speeds [rad/s] and their slopes [rad/s^2], from which thrust
            and torque then come, or (0, 8): thrust follows from the drives.
        out: (N,) `ImposedTick`, filled.
    """
    begin_flight(plant, noise[0], theta, tick)
    plant.clear_height = -1e9  # pose noise would cause large contact forces
    measured = speed.shape[0] > 0
    store(plant.rotor_speed, speed[0, 0:4] if measured else command[0, 0:4])
    for row in range(DELAY_TICKS):
        store(plant.past_commands[row], command[0])
    drives_target = np.zeros(4)
    for k in range(motion.shape[0]):
        normals, tick_out = noise[k % noise.shape[0]], out[k]
        set_state(plant.state, motion[k])
        store(plant.rotor_command, command[k])
        begin_tick(plant, maps, normals, theta)
        tick_out.rotor_speed = plant.rotor_speed
        store(drives_target, plant.rotor_target)
        if measured:
            store(plant.rotor_speed, speed[k, 0:4])
            impose_rotor_target(plant, speed[k])
            sum_rotors(plant, maps, 1.0, 0)
            derivative(plant, normals, theta, 0, plant.slope)
        plant.gyro = plant.state.rates
        tick_out.acceleration = plant.slope.velocity
        tick_out.angular_acceleration = plant.slope.rates
        tick_out.force = plant.accel = specific_force(plant)
        plant.slope.rates = motion[k, 13:16]
        apply_imu(plant, normals, theta)
        tick_out.gyro_error = subtract(plant.gyro, plant.state.rates)
        tick_out.accel_error = subtract(plant.accel, tick_out.force)
        tick_out.voltage[0] = plant.supply.voltage
        tick_out.current[0] = plant.supply.current
        plant.rotor_speed = tick_out.rotor_speed
        store(plant.rotor_target, drives_target)
        tick_out.memories = plant.memories
        advance_rotor_speeds(plant)
        plant.ticks += 1


@compiled
def simulate_mocap(
    plant: Plant, theta: Array, noise: Array, poses: Array, spacing: float
) -> Array:
    """Return what motion capture makes of true poses.

    Args:
        plant: a fresh one; its mocap sample is changed.
        theta: parameters of all effects.
        noise: (K, 9) standard normals, used in turn.
        poses: (N, 7) true position and quaternion.
        spacing: time between the samples [s].

    Returns:
        (N, 10): pose, latency [s], dropped (0/1), error of the stamp [s].
    """
    out = np.zeros((poses.shape[0], 10))
    sample = plant.mocap
    for k in range(poses.shape[0]):
        store(sample.position, poses[k, 0:3])
        store(sample.attitude, poses[k, 3:7])
        sample.latency = 0.0
        sample.stamp_error = 0.0
        sample.dropped = False
        sample.interval = spacing if k > 0 else np.inf  # no gap of before goes on
        apply_mocap(plant, noise[k % noise.shape[0]], theta)
        store(out[k, 0:3], sample.position)
        store(out[k, 3:7], sample.attitude)
        out[k, 7] = sample.latency
        out[k, 8] = sample.dropped
        out[k, 9] = sample.stamp_error
    return out


@compiled
def simulate_imu_at_rest(plant: Plant, theta: Array, noise: Array, out: Array) -> None:
    """Write what the IMU shows of a vehicle at rest: (N, 6) gyro and specific force.

    Args:
        plant: a fresh one.
        theta: parameters of all effects.
        noise: (N, 9) standard normals.
        out: (N, 6) [rad/s, m/s^2], filled.
    """
    for k in range(out.shape[0]):
        plant.gyro = ZERO
        plant.accel = (0.0, 0.0, GRAVITY)
        apply_imu(plant, noise[k], theta)
        store(out[k, 0:3], plant.gyro)
        store(out[k, 3:6], plant.accel)


@compiled
def open_loop(
    plant: Plant,
    maps: RotorMaps,
    theta: Array,
    tick: float,
    motion: Array,
    command: Array,
    speed: Array,
    along: Any,
    starts: NDArray[np.int64],
    ticks: int,
    hold_attitude: bool,
    out: Any,
) -> None:
    """Simulate windows from measured states, with the commands that were recorded.

    A load that hangs and swings goes on swinging.

    Args:
        plant: its draws are set; changed.
        maps: the rotor's table.
        theta: parameters of all effects.
        tick: distance of the rows [s].
        motion: (N, 13) measured position, velocity, quaternion, body rates.
        command: (N, 4) rotor speeds asked for [rad/s].
        speed: (N, 8) measured rotor speeds and slopes, which are then imposed, or (0, 8).
        along: (N,) `tombo_sim.inverse_simulation.ImposedTick` of the model along the measured
            motion: its rotor speeds, and what its effects remember, are where windows begin.
        starts: (W,) rows at which windows begin.
        ticks: length of a window.
        hold_attitude: True: attitude and rates stay the measured ones throughout.
        out: (W,) `State` at the end of each window, filled.
    """
    noise = np.zeros(9)
    measured = speed.shape[0] > 0
    for w in range(starts.size):
        first = starts[w]
        begin_flight(plant, noise, theta, tick)
        plant.clear_height = -1e9
        set_state(plant.state, motion[first])
        plant.rotor_speed = along[first].rotor_speed
        plant.memories = along[max(first - 1, 0)].memories
        plant.ticks = first
        for back in range(1, DELAY_TICKS + 1):
            row = max(first - back, 0)
            store(plant.past_commands[(first - back) % DELAY_TICKS], command[row])
        for k in range(first, first + ticks):
            if hold_attitude:
                plant.state.attitude = motion[k, 6:10]
                plant.state.rates = motion[k, 10:13]
            store(plant.rotor_command, command[k])
            if measured:
                store(plant.rotor_speed, speed[k, 0:4])
            begin_tick(plant, maps, noise, theta)
            if measured:
                impose_rotor_target(plant, speed[k])
                sum_rotors(plant, maps, 1.0, 0)
                sum_rotors(plant, maps, plant.half_tick_decay, 1)
                sum_rotors(plant, maps, plant.tick_decay, 2)
            finish_tick(plant, noise, theta)
        out[w] = plant.state
