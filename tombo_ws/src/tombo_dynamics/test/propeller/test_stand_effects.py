"""Faults of a stand: every effect adds nothing at null, and does what it says."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_dynamics.propeller import configuration, evaluate, parameter_row
from tombo_dynamics.propeller.effects import STAND_EFFECTS, Draws, Setup, nulls, predict
from tombo_dynamics.propeller.effects.predict import _begin

SPEED = np.linspace(0.0, 400.0, 9)


def setup(*confs: int, law: str = "repaired", plain: bool = False) -> Setup:
    n = SPEED.size
    rows = [
        np.tile([2e-8, 3e-10] if plain else parameter_row(configuration(c), law), (n, 1))
        for c in confs
    ]
    number = np.repeat(np.arange(len(confs)), n)
    elapsed = np.tile(np.linspace(0.0, 1.0, n), len(confs))
    return Setup(
        np.tile(SPEED, len(confs)), np.concatenate(rows), number, number, elapsed, law, plain
    )


def draws(s: Setup) -> Draws:
    rng = np.random.default_rng(0)
    groups = int(s.propeller.max()) + 1
    return Draws(
        rng.normal(size=(groups, 2)),
        rng.normal(size=(groups, 2)),
        rng.normal(size=s.speed.size),
        rng.normal(size=(groups, 2)),
    )


def typical(name: str) -> dict[str, tuple[float, ...]]:
    return {name: tuple(p.typical for p in STAND_EFFECTS[name].theta)}


@pytest.mark.parametrize("name", STAND_EFFECTS)
def test_an_effect_of_typical_size_shows(name):
    effect = STAND_EFFECTS[name]
    s = setup(5, 13) if effect.suits("tombo") else setup(0, plain=True)
    base = predict(s, {}, draws(s))
    assert not np.allclose(predict(s, typical(name), draws(s)), base, equal_nan=True)


@pytest.mark.parametrize("name", STAND_EFFECTS)
def test_an_effect_at_null_adds_exactly_nothing(name):
    """`predict` skips effects at null: here the functions are called all the same."""
    effect = STAND_EFFECTS[name]
    s = setup(5, 13) if effect.suits("tombo") else setup(0, plain=True)
    run, same = _begin(s, draws(s)), _begin(s, draws(s))
    run.thrust = same.thrust = np.linspace(0.1, 1.0, s.speed.size)
    effect.function(run, *nulls()[name])
    for key, value in vars(same).items():
        assert np.array_equal(getattr(run, key), value), key


def test_without_effects_the_stand_reads_the_law():
    s = setup(9)
    point = evaluate(configuration(9), SPEED)
    read = predict(s, {})
    assert np.array_equal(read[:, 0], point.thrust_N)
    assert np.array_equal(read[:, 1], point.torque_Nm)
    assert np.array_equal(read[:, 2], point.beta_rad)


def test_in_plane_term_at_one_is_the_other_law():
    read = predict(setup(5), {"in_plane_term": (1.0,)})
    other = evaluate(configuration(5), SPEED, "consistent")
    assert np.allclose(read[:, 0], other.thrust_N, rtol=1e-12)


def test_a_shared_load_halves_a_small_flap_and_keeps_a_rigid_propeller():
    assert np.allclose(
        predict(setup(0), {"load_sharing": (0.5,)}), predict(setup(0), {}), rtol=1e-12
    )
    base, half = (predict(setup(13), t)[4] for t in ({}, {"load_sharing": (0.5,)}))
    assert half[2] < base[2]  # less flap
    assert half[0] > base[0]  # less twist: more thrust


def test_inflow_takes_thrust_and_costs_torque_even_of_a_rigid_propeller():
    base, air = predict(setup(0), {}), predict(setup(0), {"inflow": (0.4,)})
    assert np.all(air[1:, 0] < base[1:, 0])
    loss = air[1:, 0] / base[1:, 0]
    assert np.allclose(loss, loss[0], rtol=1e-6)  # the same share at every speed
    assert np.all(air[1:, 1] / base[1:, 1] > loss)
    # induced power: torque has T v_i / omega in addition to the turned section's drag
    speed, thrust = SPEED[-1], air[-1, 0]
    induced = 0.4 * np.sqrt(thrust / (2 * 1.2041 * np.pi * 0.1111**2)) * thrust / speed
    assert 0.0 < induced < air[-1, 1]


def test_readings_are_exact():
    s = setup(13)
    base = predict(s, {})
    assert np.allclose(predict(s, {"thrust_gain": (0.1,)})[:, 0], 1.1 * base[:, 0])
    assert np.allclose(predict(s, {"torque_tare": (1e-3,)})[:, 1], base[:, 1] + 1e-3)
    drift = predict(s, {"thrust_drift": (0.2,)})[:, 0] - base[:, 0]
    assert np.allclose(drift, 0.2 * s.elapsed)
    fast = predict(s, {"rpm_scale": (0.05,)})
    assert np.allclose(fast[:, 3], SPEED / 1.05)
    plain = setup(0, plain=True)
    shown = predict(plain, {"rpm_scale": (0.05,)})[1:, 0] / predict(plain, {})[1:, 0]
    assert np.allclose(shown, 1.05**-2)


def test_density_equals_both_coefficients_at_a_given_deformation():
    """Force and torque know the density only as a factor of the coefficients."""
    s = setup(13)
    dense = predict(s, {"air_density": (0.1,)})
    coefficients = predict(s, {"thrust_coefficient": (0.1,), "drag_coefficient": (0.1,)})
    assert np.allclose(dense, coefficients, rtol=1e-10)


def test_known_loads_go_through_the_cell_but_not_the_propeller():
    s = setup(13)
    hung = Setup(
        s.speed, s.rows, s.propeller, s.run, s.elapsed, applied_thrust=np.full(SPEED.size, 2.0)
    )
    gain = {"thrust_gain": (0.1,)}
    assert np.allclose(predict(hung, gain)[:, 0] - predict(s, gain)[:, 0], 2.2)
    coefficient = {"thrust_coefficient": (0.1,)}
    assert np.allclose(predict(hung, coefficient)[:, 0] - predict(s, coefficient)[:, 0], 2.0)


def test_each_propeller_and_run_draws_its_own():
    s = setup(13, 13, 13)
    base = predict(s, {})[:, 0].reshape(3, -1)[:, 4:]
    scattered = predict(s, {"fabrication_scatter": (0.05, 0.0)}, draws(s))[:, 0]
    by = scattered.reshape(3, -1)[:, 4:] / base
    assert np.ptp(by.mean(axis=1)) > 5.0 * np.ptp(by, axis=1).max() / 3.0
    tare = predict(s, {"tare_scatter": (0.05, 0.0)}, draws(s))[:, 0] - predict(s, {})[:, 0]
    assert np.allclose(np.ptp(tare.reshape(3, -1), axis=1), 0.0, atol=1e-12)
    assert np.ptp(tare) > 0.01
