"""The simulator tick by tick: its poses, its random numbers, refused input.

That it is the compiled flight's plant to the last bit shows `tombo_flight/test/test_fused_flight`.
"""

from __future__ import annotations

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_sim.simulator import Simulator
from tombo_sim.world import ObstacleParams, World

RAGGED = {
    "mocap_latency": {"delay": 0.03, "jitter": 0.02},
    "mocap_dropouts": {"probability": 0.03, "duration": 0.1},
}


def test_a_pose_arrives_once_and_not_before_its_time() -> None:
    simulator = Simulator(World(effects=RAGGED), 5)
    captured = []
    for k in range(3000):
        for sample in simulator.arrived:
            assert k == sample.arrives >= sample.captured
            captured.append(sample.captured)
        simulator.advance(np.zeros(4))
    assert len(set(captured)) == len(captured) > 60
    assert captured != sorted(captured), "some overtake others"


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
