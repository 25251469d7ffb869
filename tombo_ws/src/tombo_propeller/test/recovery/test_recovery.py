"""Collisions in a trace: when, and how long until 90 % are back."""

import math

import numpy as np
import pytest
from one_vehicle import Vehicle, hover_speed

from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import ARM_X, ARM_Y, VehicleParams
from tombo_propeller.recovery import recoveries

STEP = 1e-3
POLE = 0.25


def on_the_bench(recovery_time, hits=1, wear=0.0, apart=1.6):
    """Thrust [N] of the front-left rotor of a fixed vehicle, whose pole comes and goes.

    A strike begins at 0.5 s and every `apart` seconds.
    """
    p = VehicleParams()
    gap = p.rotor_radius + POLE - 0.001
    axis = (p.arm_length * ARM_X[2] + gap, p.arm_length * ARM_Y[2])
    strike = {"peak_force": 145.5, "recovery_time": recovery_time, "slant": 0.4, "duration": 0.014}
    v = Vehicle(
        {"blade_strike": strike, "propeller_wear": {"collisions": wear}},
        obstacle=(*axis, POLE, 100.0), position=(0.0, 0.0, 2.0), speed=hover_speed(),
    )  # fmt: skip
    body, thrust = v.body, []
    for k in range(round(1e3 * (0.5 + apart * hits))):
        since = (k - 500) % round(1e3 * apart)
        v.plant.obstacle.radius = POLE if k >= 500 and since < 10 else 0.0
        v.body = body
        v.begin()
        thrust.append(v.plant.rotor_thrust[2])
        v.finish()
    return np.arange(len(thrust)) * STEP, np.array(thrust)


def truth_of(thrust):
    level = thrust[:499].mean()
    low = int(np.argmin(thrust))
    return (low + int(np.argmax(thrust[low:] > 0.9 * level)) - 500) * STEP


@pytest.fixture(scope="module")
def struck():
    return {r: on_the_bench(r) for r in (0.30, 0.42, 0.66)}


@pytest.mark.slow
@pytest.mark.parametrize("recovery_time", [0.30, 0.42, 0.66])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.08])
def test_the_simulators_strikes_come_out_and_the_interval_holds(struck, recovery_time, noise):
    t, thrust = struck[recovery_time]
    truth, inside = truth_of(thrust), 0
    rng = np.random.default_rng(3)
    for _ in range(30):
        (found,) = recoveries(t, thrust + noise * thrust[0] * rng.standard_normal(len(t)))
        assert found.recovered == pytest.approx(truth, abs=0.01 + 0.4 * noise)
        assert found.time == pytest.approx(0.5, abs=0.003)
        inside += found.low <= truth <= found.high
    assert inside >= 26


def test_each_collision_is_found_and_the_last_does_not_recover():
    t, thrust = on_the_bench(0.42, hits=3, wear=3.0)
    noisy = thrust + 0.1 * np.random.default_rng(0).standard_normal(len(t))
    found = recoveries(t, noisy)
    assert [r.time for r in found] == pytest.approx([0.5, 2.1, 3.7], abs=0.005)
    assert found[0].recovered == pytest.approx(found[1].recovered, abs=0.05)
    assert found[2].why and found[2].as_text().startswith("more than")
    assert math.isnan(found[2].recovered) and math.isinf(found[2].high)


def test_a_trace_that_ends_too_early_says_at_least():
    t, thrust = on_the_bench(0.66)
    cut = t < 0.9
    (found,) = recoveries(t[cut], thrust[cut])
    assert "ends before" in found.why
    assert found.low == pytest.approx(0.4, abs=0.01)


def test_a_second_strike_before_the_first_is_over():
    t = np.arange(2500) * STEP
    since = np.where(t < 0.5, np.inf, np.where(t < 0.75, t - 0.5, t - 0.75))
    first, second = recoveries(t, 5.0 * (1.0 - np.exp(-since / 0.15)))
    assert "another collision" in first.why
    assert second.time == pytest.approx(0.75, abs=0.005)
    assert second.level == pytest.approx(5.0)  # recovery is the return to the first level
    assert second.recovered == pytest.approx(0.15 * math.log(10.0), rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2])
def test_without_a_collision_there_is_no_recovery(noise):
    t = np.arange(3000) * STEP
    for seed in range(5):
        value = 5.0 + 0.3 * np.sin(3.0 * t) + noise * np.random.default_rng(seed).normal(size=3000)
        with pytest.raises(InputError, match="no collision"):
            recoveries(t, value)


def test_slow_throttle_and_spikes_are_no_collisions():
    t = np.arange(4000) * STEP
    with pytest.raises(InputError, match="no collision"):
        recoveries(t, 6.0 - 1.2 * t)
    spiked = np.full(4000, 5.0)
    spiked[[700, 1900]] = 0.0
    with pytest.raises(InputError, match="no collision"):
        recoveries(t, spiked)


@pytest.mark.parametrize(
    "t, why",
    [
        (np.arange(10) * STEP, "samples"),
        (np.zeros(100), "does not rise"),
        (np.arange(100) * 1.0, "in seconds"),
        (np.concatenate([np.arange(100), np.arange(100) + 5000]) * STEP, "gap"),
        (np.full(100, np.nan), "0 samples"),
    ],
)
def test_times_that_are_none_are_refused(t, why):
    with pytest.raises(InputError, match=why):
        recoveries(t, np.full(len(t), 5.0))


def test_a_reversed_sign_is_named():
    t = np.arange(2000) * STEP
    folded = np.where(t < 0.5, 0.0, np.exp(-(t - 0.5) / 0.15))
    with pytest.raises(InputError, match=r"level of -4.* sign reversed.*accepted"):
        recoveries(t, -5.0 * (1.0 - folded))
