"""The drive curve, against data made with a curve that is known."""

from dataclasses import replace

import numpy as np
import pytest

from tombo_diagnosis.flight.fit.drive_curve import DriveSamples, fit_drive_curve


def flight(seed, swing, supply, noise=0.003):
    """Return samples of 0.8 · mean(c^1.2) · V^0.7, whose thrust varies by the share `swing`."""
    rng = np.random.default_rng(seed)
    load = 1.0 + swing * np.sin(np.linspace(0.0, 40.0, 2000))
    voltage = np.linspace(*supply, 2000)
    command = (load / 0.8 / voltage**0.7) ** (1.0 / 1.2)
    spread = 1.0 + 0.02 * np.array([1.0, -1.0, 1.0, -1.0])
    values = command[:, None] * spread
    return DriveSamples(values, load * (1.0 + noise * rng.standard_normal(2000)), voltage, 0.01)


def test_exponents_are_found_where_flights_show_them():
    curve = fit_drive_curve([flight(k, 0.3, (4.1 - 0.2 * k, 3.6)) for k in range(4)], 1.0)
    assert curve.exponent == pytest.approx(1.2, abs=0.03)
    assert curve.supply_exponent == pytest.approx(0.7, abs=0.1)
    assert curve.exponent == pytest.approx(1.2, abs=2.0 * curve.deviation[0])
    assert curve.supply_exponent == pytest.approx(0.7, abs=2.0 * curve.deviation[1])
    assert max(curve.deviation) < 0.1
    samples = flight(0, 0.3, (4.1, 3.6), 0.0)
    total = np.exp(curve.demand(samples.command, samples.voltage)).mean(axis=1)
    assert np.std(np.log(total / samples.load_factor)) < 0.2 * np.std(np.log(total))


@pytest.mark.parametrize("compensated", [False, True])
def test_a_battery_that_sags_with_thrust_does_not_flatten_the_curve(compensated):
    """Of a motor on a duty cycle thrust follows command times voltage, the fast part as well."""
    made = []
    for k in range(4):
        f = flight(k, 0.3, (4.1 - 0.1 * k, 3.7), 0.002)
        sag = -0.1 * (f.load_factor - 1.0)
        power = 0.0 if compensated else 1.0
        whole = np.exp(sag) * f.voltage
        command = (f.load_factor / 0.8) ** (1.0 / 1.4) / whole**power
        made.append(replace(f, command=np.tile(command[:, None], 4), sag=sag))
    curve = fit_drive_curve(made, 1.0)
    assert curve.exponent == pytest.approx(1.4, abs=0.04)
    assert curve.supply_exponent == pytest.approx(0.0 if compensated else 1.4, abs=0.1)


def test_the_intervals_hold_the_truth_as_often_as_they_say():
    """Noise that is slow, as of air, and an offset of each flight."""
    off = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        made = [flight(10 * seed + k, 0.1, (4.1 - 0.1 * k, 3.8)) for k in range(4)]
        slow = [np.repeat(0.005 * rng.standard_normal(20), 100) for _ in made]
        made = [
            DriveSamples(
                f.command,
                f.load_factor * np.exp(s + 0.005 * rng.standard_normal()),
                f.voltage,
                f.step,
            )
            for f, s in zip(made, slow, strict=True)
        ]
        curve = fit_drive_curve(made, 1.0)
        error = np.array([curve.exponent - 1.2, curve.supply_exponent - 0.7])
        off.append(error / curve.deviation)
    assert np.mean(np.abs(off) < 2.0) > 0.8 and 0.5 < np.std(off) < 1.6
