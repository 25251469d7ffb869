"""The reference of how a flight runs: the cores of a wiring hosted tick by tick, in plain Python.

In each tick of 1 ms the simulator senses. Every core takes the sensor messages of this tick and
the other cores' messages of earlier ticks, in the order of its `inputs`. It is stepped if its
period is due or a message has come. The rotor command of the tick acts in it. Within a tick no
core depends on another, so nodes in lockstep fly the same flight to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Core, CoreRunner
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import Imu, Phase, Pose
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS, TICK_NS
from tombo_flight.scenario import Scenario, world_of
from tombo_flight.wiring import core_of
from tombo_sim.failsafe import Failsafe
from tombo_sim.ground_truth import FlightEndDetector
from tombo_sim.simulator import Simulator
from tombo_sim.wiring import COMMAND, CORES, IMU, PHASE, POSE

Record = Callable[[str, Any], None]
"""Told every message: topic, message."""


def run_cores(
    cores: Iterable[Core],
    simulator: Simulator,
    ticks: int,
    flight_end: FlightEndDetector,
    record: Record,
) -> int:
    """Fly until the flight is over; return the ticks flown.

    Args:
        cores: those of the wiring.
        simulator: at tick 0.
        ticks: at most so many.
        flight_end: decides from truth and phase when to end.
        record: told every message.
    """
    runners = [CoreRunner(core) for core in cores]
    command: Array = np.zeros(4)
    phase = int(Phase.IDLE)
    tick, end = 0, ticks
    while tick < end:
        now_ns = EPOCH_NS + tick * TICK_NS
        for topic, message in sensed(simulator, now_ns):
            record(topic, message)
            for runner in runners:
                runner.take(topic, message)
        over_s = flight_end.watch(simulator.height, simulator.upright, phase)
        if over_s is not None:
            end = min(end, tick + round(over_s * SECOND_NS / TICK_NS))
        published = [entry for runner in runners for entry in runner.run(now_ns)]
        for topic, message in published:
            record(topic, message)
            for runner in runners:
                runner.take(topic, message)
            if topic == COMMAND:
                command = message.speed
            elif topic == PHASE:
                phase = message.phase
        simulator.advance(command)
        tick += 1
    return tick


def sensed(simulator: Simulator, now_ns: int) -> list[tuple[str, Any]]:
    """Return the sensor messages of the present tick, as (topic, message)."""
    messages: list[tuple[str, Any]] = []
    for sample in simulator.arrived:
        position, attitude = sample.pose[:3].copy(), sample.pose[3:].copy()
        pose = Pose(EPOCH_NS + sample.stamp_ns, FRAME_MAP, position, attitude)
        messages.append((POSE, pose))
    imu = simulator.imu.copy()
    return [*messages, (IMU, Imu(now_ns, imu[:3], imu[3:]))]


def run_wiring(scenario: Scenario, seed: int, record: Record) -> int:
    """Fly a scenario by its wiring; return the ticks flown.

    Raises:
        InputError: as `Simulator`.
    """
    return run_cores(
        [core_of(kind, scenario) for kind in CORES],
        Simulator(world_of(scenario), seed),
        round(scenario.duration * SECOND_NS / TICK_NS),
        FlightEndDetector(scenario.vehicle.leg_height),
        record,
    )


_SECONDS = 0.25


def warm_up_nodes(scenario: Scenario) -> None:
    """Fly a quarter of a second by the wiring, and the fail-safe.

    Raises:
        InputError: as `Simulator`.
    """
    run_wiring(replace(scenario, duration=_SECONDS), 0, lambda topic, message: None)
    simulator = Simulator(world_of(scenario), 0)
    failsafe = Failsafe(simulator, scenario.vehicle)
    failsafe.engage(0)
    for _ in range(2):
        simulator.advance(failsafe.command)
        failsafe.observe(simulator)
