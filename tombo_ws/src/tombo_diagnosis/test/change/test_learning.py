"""What flights of known changes teach: widths that a hidden vehicle has are learnt from them."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_sessions import Vehicle

from tombo_diagnosis.change.comparison import compare, spread_of
from tombo_diagnosis.change.features import mean_of
from tombo_diagnosis.change.learning import KnownChange, learnt_widths
from tombo_diagnosis.change.likelihood import GUESSED
from tombo_diagnosis.change.signatures import candidates
from tombo_diagnosis.flight.nominal import nominal_model


@pytest.fixture(scope="module")
def tried():
    nominal = nominal_model()
    return candidates(nominal.vehicle, nominal.maps, np.geomspace(0.004, 0.5, 20))


def taught(rng, rough, tried):
    """A weak propeller of 10 %, with shake that differs by `rough` from what is predicted."""
    vehicle, shift = Vehicle(rng), np.zeros(9)
    shift[0], shift[4:6] = -np.log(0.9), rng.normal(0.0, rough, 2)
    healthy, new = vehicle.session(3) + vehicle.session(3), vehicle.session(3, shift)
    spread = spread_of(healthy, ["a"] * 3 + ["b"] * 3)
    causes = tuple(c for c in tried if c.label == "weak_propeller.front_right")
    moved = mean_of(new).vector - spread.mean.vector
    return KnownChange(spread.scale(3), spread.degrees, moved, causes), spread, new


def test_widths_follow_flights_of_known_changes_and_change_what_is_said(tried):
    calm, wild = (
        learnt_widths([taught(rng, rough, tried)[0] for _ in range(8)])
        for rng, rough in ((np.random.default_rng(3), 0.0), (np.random.default_rng(3), 1.2))
    )
    assert calm.rough < 0.6 * GUESSED.rough and wild.rough > 1.5 * GUESSED.rough
    assert calm.swung == pytest.approx(GUESSED.swung, rel=0.02)  # no load was hung
    _, spread, new = taught(np.random.default_rng(4), 1.2, tried)
    narrow, wide = (
        compare(spread, new, tried, widths=replace(GUESSED, rough=w.rough)).none
        for w in (calm, wild)
    )
    assert narrow != pytest.approx(wide, rel=0.1)


@pytest.mark.parametrize("size", [0.12, 0.2])
def test_a_size_is_what_flights_say_whatever_is_usual(tried, size):
    """One session alone: it is known badly how much sessions differ."""
    vehicle, shift = Vehicle(np.random.default_rng(8)), np.zeros(9)
    shift[:4] = np.log(1.0 + size)
    healthy = [replace(f, demand=np.zeros(4)) for f in vehicle.session(3)]
    new = [replace(f, demand=shift[:4]) for f in healthy]
    spread = spread_of(healthy, ["a"] * 3)
    mass = next(
        r for r in compare(spread, new, tried).results if r.candidate.label == "mass_error"
    )
    assert mass.size[0] == pytest.approx(size, abs=0.005)
    assert mass.low[0] < size < mass.high[0]
