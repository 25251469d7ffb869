"""The simulator tick by tick is the headless flight's plant: same seed and commands, same flight.

To the last bit but one: the fused kernel contracts multiply-adds where single functions do not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tombo_bag.flight import Flight
from tombo_dynamics.errors import InputError
from tombo_dynamics.records import numbers
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_sim.ground_truth import contact_force
from tombo_sim.simulator import Simulator
from tombo_sim.world import ObstacleParams, World

_ROUNDING = 1e-10
_QUICK = (
    "mission.takeoff_time=0.2",
    "mission.climb_speed=1.0",
    "mission.approach_time=4.0",
    "mission.hold_time=0.3",
    "duration=12",
)
_FLIGHTS = {
    "collision": ("paper_collision", 3, _QUICK),
    "mocap at 120 Hz, late, lossy, in gusts": (
        "hover",
        5,
        (
            "mission.takeoff_time=0.2",
            "mission.land_time=3.0",
            "duration=5",
            "estimator.mocap_rate=120",
            "effects.mocap_latency.delay=0.03",
            "effects.mocap_latency.jitter=0.02",
            "effects.mocap_dropouts.probability=0.03",
            "effects.gusts.deviation=0.5",
        ),
    ),
    "mocap with stamps 12.3 ms late, from a point off the centre": (
        "hover",
        6,
        (
            "mission.takeoff_time=0.2",
            "duration=4",
            "effects.mocap_latency.delay=0.03",
            "effects.mocap_stamp_error.offset=0.0123",
            "effects.mocap_marker_offset.z=0.05",
            "effects.imu_lever_arm.x=0.05",
        ),
    ),
}


def _scenario(name: str) -> tuple[Scenario, int]:
    base, seed, settings = _FLIGHTS[name]
    return load_scenario(base, settings), seed


class _Flown:
    """A headless flight, and the simulator fed with its commands."""

    def __init__(self, name: str) -> None:
        scenario, seed = _scenario(name)
        self.record: Flight = fly_scenario(scenario, seed)
        log = self.record.log
        simulator = Simulator(world_of(scenario), seed)
        plant = simulator.plant
        self.body = np.zeros((len(self.record.t), 13))
        self.imu = np.zeros((len(self.record.t), 6))
        self.rotors = np.zeros((len(self.record.t), 16))
        self.touch = np.zeros((len(self.record.t), 8))
        self.poses: list[Any] = []
        for k, command in enumerate(log["rotor_command"]):
            assert simulator.tick == k
            self.body[k] = numbers(plant.state)
            self.imu[k] = simulator.imu
            rotors = [plant.rotor_speed, plant.rotor_thrust, plant.fold, plant.damage]
            self.rotors[k] = np.concatenate(rotors)
            self.touch[k, :3] = contact_force(plant)
            self.touch[k, 3:5] = plant.contact.touching, plant.contact.rotor
            self.touch[k, 5:] = plant.contact.point
            self.poses += [(k, sample) for sample in simulator.arrived]
            simulator.advance(command)


@pytest.fixture(scope="module", params=list(_FLIGHTS))
def flown(request: pytest.FixtureRequest) -> _Flown:
    return _Flown(request.param)


def test_truth_is_the_headless_flights(flown: _Flown) -> None:
    log = flown.record.log
    true = np.hstack([log["position"], log["velocity"], log["attitude"], log["rates"]])
    assert np.abs(flown.body - true).max() < _ROUNDING
    names = ("rotor_speed", "rotor_thrust", "fold", "damage")
    assert np.allclose(flown.rotors, np.hstack([log[name] for name in names]), rtol=1e-10)


def test_imu_is_the_headless_flights(flown: _Flown) -> None:
    log = flown.record.log
    assert np.abs(flown.imu - np.hstack([log["gyro"], log["accel"]])).max() < _ROUNDING


def test_each_touch_is_the_headless_flights(flown: _Flown) -> None:
    log = flown.record.log
    touching = log["contact"][:, 0] > 0.0
    assert np.array_equal(flown.touch[:, 3] > 0.0, touching)
    assert np.allclose(flown.touch[touching, 4:], log["contact"][touching, 1:], atol=_ROUNDING)
    force = log["contact_force"][touching]
    assert np.allclose(flown.touch[touching, :3], force, rtol=1e-9, atol=1e-9)


def test_mocap_samples_are_the_headless_flights_in_value_and_order(flown: _Flown) -> None:
    record = flown.record
    # the headless flight hands over one sample a tick: of two that arrive at once one waits a tick
    poses = record["/mocap/pose"]
    last = poses.arrival[-1]
    arrived = [(k, sample) for k, sample in flown.poses if k * 1e-3 <= last + 1e-9]
    assert len(arrived) == len(poses.t) > 80
    by_capture = sorted(arrived, key=lambda item: item[1].captured)
    order = np.argsort(poses.t, kind="stable")
    captured = np.array([sample.captured for _, sample in by_capture])
    assert np.array_equal(captured, np.rint(poses.t[order] * 1e3))
    pose = np.array([sample.pose for _, sample in by_capture])
    assert np.abs(pose[:, :3] - poses["position"].values[order]).max() < _ROUNDING
    assert np.abs(pose[:, 3:] - poses["attitude"].values[order]).max() < _ROUNDING
    arrival = np.array([k for k, _ in by_capture]) * 1e-3
    assert np.abs(arrival - poses.arrival[order]).max() < 3.5e-3


def test_a_pose_arrives_once_and_not_before_its_time(flown: _Flown) -> None:
    captured = [sample.captured for _, sample in flown.poses]
    assert len(set(captured)) == len(captured)
    assert all(k == sample.arrives >= sample.captured for k, sample in flown.poses)


def test_the_collision_flight_does_collide() -> None:
    scenario, seed = _scenario("collision")
    assert fly_scenario(scenario, seed).summary["collided"]


def test_another_seed_is_another_flight() -> None:
    world = world_of(_scenario("collision")[0])
    first, second = Simulator(world, 3), Simulator(world, 4)
    assert not np.array_equal(first.setup.start, second.setup.start)
    assert not np.array_equal(first.imu, second.imu)


def test_chance_does_not_repeat_from_one_block_of_noise_to_the_next() -> None:
    simulator = Simulator(World(effects={"imu_noise": {"gyro": 0.01, "accel": 0.0}}), 1)
    gyro = []
    for _ in range(2 * 4096 + 10):
        gyro.append(simulator.imu[0])
        simulator.advance(np.zeros(4))
    assert len(set(gyro)) == len(gyro)


def test_a_start_inside_the_obstacle_is_refused() -> None:
    with pytest.raises(InputError, match="obstacle"):
        Simulator(World(obstacle=ObstacleParams(x=0.1, y=0.0, radius=0.3, top=1.0)), 0)
