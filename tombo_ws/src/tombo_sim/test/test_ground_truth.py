"""The ground truth that nodes publish is that of a recorded headless flight, to the last bit."""

import numpy as np

from tombo_dynamics.rotation import rotated_back_rows, rotation_matrix
from tombo_sim.ground_truth import true_state
from tombo_sim.simulator import Simulator
from tombo_sim.world import World


def test_the_velocity_of_one_tick_is_that_of_whole_columns():
    plant = Simulator(World(), 0).plant
    chance = np.random.default_rng(5)
    attitudes = chance.normal(size=(200, 4))
    attitudes /= np.linalg.norm(attitudes, axis=1)[:, None]
    velocities = chance.normal(size=(200, 3))
    out, single = np.zeros(13), np.empty((200, 3))

    for i in range(200):
        plant.state.attitude[:] = attitudes[i]
        plant.state.velocity[:] = velocities[i]
        rotation_matrix(attitudes[i], plant.rotation)
        true_state(plant, out)
        single[i] = out[7:10]

    assert (single == rotated_back_rows(attitudes, velocities)).all()
    assert np.allclose(np.linalg.norm(single, axis=1), np.linalg.norm(velocities, axis=1))
