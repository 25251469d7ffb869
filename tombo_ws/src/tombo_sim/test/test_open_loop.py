"""Open-loop simulation from states of a flight: with the true model it flies the same."""

import numpy as np
import pytest
from kernel_flight import NOISE, TICK, commands_of, fly_kernel, maps, motion_of, vehicle_of

from tombo_dynamics.effects.compose import pack_theta
from tombo_dynamics.plant import State
from tombo_sim.inverse_simulation import ImposedTick, open_loop, run_along_motion

SEED = 6
EFFECTS = {
    "linear_rotor_drag": {"d_xy": 0.3, "d_z": 0.1},
    "steady_wind": {"east": 1.0},
    "command_delay": {"delay": 0.008},
    "thrust_scatter": {"deviation": 0.03},
}
STARTS = np.array([300, 700, 1300])
HALF_A_SECOND = 500


@pytest.fixture(scope="module")
def flight():
    return fly_kernel(EFFECTS, seconds=2.0, seed=SEED)


def let_go(flight, effects, hold=False, speed=None, ticks=HALF_A_SECOND):
    motion = motion_of(flight)
    command = commands_of(flight)
    theta = pack_theta(effects)
    model = np.zeros(motion.shape[0], ImposedTick.layout)
    measured = np.zeros((0, 8)) if speed is None else speed
    still = np.zeros((1, NOISE))
    run_along_motion(
        vehicle_of(SEED), maps(), theta, still, TICK, motion, command, measured, model
    )
    out = np.zeros(STARTS.size, State.layout)
    open_loop(vehicle_of(SEED), maps(), theta, TICK, motion, command, measured, model, STARTS,
              ticks, hold, out)  # fmt: skip
    return out.view(np.float64).reshape(-1, 13) - motion[STARTS + ticks, :13]


@pytest.mark.slow
def test_true_model_reproduces_the_flight(flight):
    off = let_go(flight, EFFECTS)
    assert np.abs(off[:, :3]).max() < 1e-3
    assert np.abs(off[:, 3:6]).max() < 5e-3
    assert np.abs(off[:, 6:10]).max() < 1e-3


@pytest.mark.slow
def test_a_vehicle_taken_for_too_heavy_sinks(flight):
    """Ten per cent of mass are a tenth of gravity, less what drag takes back."""
    off = let_go(flight, {**EFFECTS, "mass_error": {"fraction": 0.1}})
    fall = 0.5 * 0.1 / 1.1 * 9.81 * 0.5**2
    assert off[:, 2] == pytest.approx(-fall, rel=0.2)


@pytest.mark.slow
def test_a_load_on_a_thread_swings_on_in_every_window():
    """Its memory is that of the flight, not of the window before or of a load at rest."""
    pushed = {"hanging_load": {"mass": 0.3, "length": 0.4}, "steady_wind": {"east": 6.0}}
    loaded = {**EFFECTS, **pushed}
    flown = fly_kernel(loaded, seconds=2.0, seed=SEED)
    off = let_go(flown, loaded)
    assert np.abs(off[:, :3]).max() < 3e-3
    assert np.abs(off[:, 3:6]).max() < 0.02


def test_an_attitude_that_is_held_stays_the_measured_one(flight):
    """Wrong inertia does then not matter: only forces are let go."""
    odd = {**EFFECTS, "inertia_error": {"xx": 0.8, "yy": 0.8}, "cog_offset": {"x": 0.05}}
    free, held = let_go(flight, odd), let_go(flight, odd, hold=True)
    assert np.abs(held[:, :3]).max() < 2e-3
    assert np.abs(free[:, 6:10]).max() > 0.05
