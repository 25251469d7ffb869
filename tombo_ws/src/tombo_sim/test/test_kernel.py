"""The fused kernel: its flight and its log, equal every time."""

import numpy as np
import pytest
from kernel_flight import IN_THE_WAY, NOISE, NOISY, TICK, fly_kernel
from scipy.spatial.transform import Rotation

from tombo_dynamics.records import numbers
from tombo_dynamics.vehicle import GRAVITY, VehicleParams

TRUTH = ("position", "velocity", "attitude", "rates", "rotor_speed")


def same(first, other):
    assert first.begins_like(other)
    assert (first.mocap == other.mocap).all()
    assert first.plant == other.plant
    assert first.a.tobytes() == other.a.tobytes()
    assert first.delivered == other.delivered


# --- determinism ----------------------------------------------------------------------------


def test_same_seed_same_flight_to_the_last_bit():
    same(*(fly_kernel(NOISY, seconds=2.0, seed=3, **IN_THE_WAY) for _ in range(2)))


@pytest.mark.parametrize("chunk, block", [(1, 10**9), (7, 10**9), (10**9, 100), (33, 64)])
def test_a_flight_in_pieces_is_the_flight_in_one(chunk, block):
    uncut = fly_kernel(NOISY, seconds=1.0, seed=5, **IN_THE_WAY)
    same(uncut, fly_kernel(NOISY, seconds=1.0, seed=5, chunk=chunk, block=block, **IN_THE_WAY))


# --- noise ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quantity", "columns"), [("wind", [0, 1, 2]), ("gyro", [3, 4, 5]), ("accel", [6, 7, 8])]
)
def test_each_noise_has_its_own_columns(quantity, columns):
    """Other numbers in its columns change that quantity in the first tick, and no other one."""
    noise = np.random.default_rng(1).standard_normal((1, NOISE))
    other = noise.copy()
    other[:, columns] += 1.0
    effects = {"gusts": {"deviation": 0.5}, "imu_noise": {"gyro": 0.01, "accel": 0.3}}
    first = fly_kernel(effects, seconds=TICK, tick_noise=noise)
    second = fly_kernel(effects, seconds=TICK, tick_noise=other)
    for compared in ("wind", "gyro", "accel"):
        changed = (first[compared] != second[compared]).any()
        assert changed == (compared == quantity)


# --- physics in the log ---------------------------------------------------------------------


def test_the_log_obeys_newton():
    """The accelerometer's specific force, turned into map, with gravity gives the acceleration."""
    f = fly_kernel({"linear_rotor_drag": {"d_xy": 0.3}, "steady_wind": {"east": 3.0}})
    force = Rotation.from_quat(f["attitude"]).apply(f["accel"])
    expected = np.add(force, (0.0, 0.0, -GRAVITY))
    measured = np.diff(f["velocity"], axis=0) / TICK
    middle = 0.5 * (expected[1:] + expected[:-1])
    assert measured == pytest.approx(middle, abs=2e-3)
    assert np.abs(measured).max() > 0.1
    way = np.diff(f["position"], axis=0) / TICK
    assert way == pytest.approx(0.5 * (f["velocity"][1:] + f["velocity"][:-1]), abs=1e-4)


def test_state_after_a_tick_is_in_its_log_row():
    f = fly_kernel(NOISY | {"steady_wind": {"east": 2.0}}, seconds=3.0, seed=8, **IN_THE_WAY)
    for name in ("rotor_thrust", "fold", "damage", "wind", "rotor_command", "gyro", "accel"):
        assert (f[name][-1] == f.plant[name]).all()
    assert (f["battery"][-1] == numbers(f.plant.supply)).all()
    assert f["damage"][-1].any() and f["wind"][-1].all() and f["battery"][-1].all()
    assert (np.diff(f["battery"][:, 0]) > 0.0).all()  # charge is used up


def test_the_force_of_a_contact_is_in_the_log_while_it_lasts():
    effects = {
        name: NOISY[name] for name in ("blade_strike", "contact_force", "linear_rotor_drag")
    }
    f = fly_kernel(effects, seconds=3.0, **IN_THE_WAY)
    touching = f["contact"][:, 0] > 0.0
    force = np.linalg.norm(f["contact_force"], axis=1)
    assert touching.any() and not touching.all()
    assert not force[~touching].any()
    first = np.argmax(touching)
    assert force[first] > 1.0
    place = f["contact"][first, 2:5]
    assert np.linalg.norm(place[:2] - [0.6, 0.3]) == pytest.approx(0.1, abs=0.01)
    # what pushes is what moves: momentum over the first strike, in the horizontal plane
    strike = slice(first, first + 14)
    impulse = TICK * f["contact_force"][strike].sum(axis=0)
    gained = VehicleParams().mass * (f["velocity"][first + 14] - f["velocity"][first])
    assert np.linalg.norm(impulse) > 0.3
    assert gained[:2] == pytest.approx(impulse[:2], abs=0.1)


def test_every_column_of_the_log_is_written_in_every_tick():
    flight = fly_kernel(NOISY, seconds=0.5, **IN_THE_WAY)
    assert all(np.isfinite(values).all() for values in flight.columns.values())
    constant = {n for n, values in flight.columns.items() if not np.ptp(values, axis=0).any()}
    resting = {f"{name}_setpoint" for name in ("position", "velocity", "acceleration")}
    assert constant <= {*resting, "mode", "damage", "fold", "contact", "contact_force"}
