"""What IMU and motion capture measure of the plant, tick by tick."""

from __future__ import annotations

from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import apply_imu, apply_mocap
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import begin_tick
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vectors import Vector


class MocapEntry(Record):
    """A captured pose in the table of a flight."""

    stamp = field("tick", "capture as the stamp says it, with fraction")
    arrives = field("tick", "-1: dropped", kind=int)
    delivered = field("1", "", kind=bool)
    position = field("m", "map", 3)
    attitude = field("1", "quaternion xyzw, map from base_link", 4)


class Captures(Record):
    """How far the table is filled and read."""

    next = field("1", "index of the next sample to capture", kind=int)
    oldest_undelivered = field("1", "index; all before it have arrived or never will", kind=int)
    latest_tick = field("tick", "of the latest capture", kind=int)


@compiled
def specific_force(plant: Plant) -> Vector:
    """Return force without gravity over mass [m/s^2], body."""
    force, mass = plant.force, plant.mass
    return force[0] / mass, force[1] / mass, force[2] / mass


@compiled
def read_imu(plant: Plant, maps: RotorMaps, noise: Array, theta: Array) -> None:
    """Begin the tick and read the IMU: body rates, and force without gravity over mass."""
    begin_tick(plant, maps, noise, theta)
    plant.gyro = plant.state.rates
    plant.accel = specific_force(plant)
    apply_imu(plant, noise, theta)


@compiled(inline=False)
def capture_pose(
    plant: Plant, mocap_noise: Array, theta: Array, entries: Any, captures: Captures, tick: int
) -> None:
    """Take a mocap sample of the true pose and enter it, with its time of arrival."""
    sample, entry = plant.mocap, entries[captures.next]
    sample.position = plant.state.position
    sample.attitude = plant.state.attitude
    sample.latency = 0.0
    sample.stamp_error = 0.0
    sample.dropped = False
    sample.interval = (tick - captures.latest_tick) * plant.tick_length
    apply_mocap(plant, mocap_noise[captures.next], theta)
    entry.stamp = tick + sample.stamp_error / plant.tick_length
    entry.delivered = False
    entry.arrives = -1
    if not sample.dropped:
        entry.arrives = tick + int(sample.latency / plant.tick_length + 0.5)
    entry.position = sample.position
    entry.attitude = sample.attitude
    captures.next += 1
    captures.latest_tick = tick


@compiled(inline=False)
def next_arrival(entries: Any, captures: Captures, tick: int) -> int:
    """Return the index of a sample that has arrived by `tick`, each once, or -1."""
    head = captures.oldest_undelivered
    while head < captures.next and (entries[head].arrives < 0 or entries[head].delivered):
        head += 1
    captures.oldest_undelivered = head
    for i in range(head, captures.next):
        entry = entries[i]
        if not entry.delivered and 0 <= entry.arrives <= tick:
            entry.delivered = True
            entry.arrives = tick
            return i
    return -1


def in_order_of_arrival(entries: Any) -> Any:
    """Return the rows of the `MocapEntry` that have arrived, as they were handed over."""
    rows = np.flatnonzero(entries["delivered"])
    return rows[np.argsort(entries["arrives"][rows], kind="stable")]
