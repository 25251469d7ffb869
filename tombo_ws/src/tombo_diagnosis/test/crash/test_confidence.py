"""How sure the answer is that nothing is wrong: sounder than even, not as sure as its signs."""

import numpy as np

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.crash.reason import why

T = np.arange(0.0, 6.0, 0.01)
QUIET = {"gyro": Series(T, 0.01 * np.random.default_rng(6).standard_normal((T.size, 3)))}


def flight(fallen_m, more=None):
    t = T
    noise = 0.0005 * np.random.default_rng(5).standard_normal((t.size, 3))
    place = np.column_stack([0.1 * np.sin(t), 0.1 * np.cos(t), np.full(t.size, 3.0)])
    since = np.clip(t - 4.0, 0.0, 0.5)
    place[:, 2] -= fallen_m * (since / 0.5) ** 2
    return Flight.measured("flight", "", {"position": Series(t, place + noise), **(more or {})})


def test_a_log_without_a_sign_may_be_of_a_mishap_that_leaves_none():
    """By Laplace 5 of 12 mishaps leave none in poses alone, 1 of 11 where more is measured."""
    sound, felt, fallen = why(flight(0.0)), why(flight(0.0, QUIET)), why(flight(1.2))
    assert sound.cause == felt.cause == "none" and fallen.cause != "none"
    assert abs(sound.confidence - 12.0 / 17.0) < 1e-9
    assert abs(felt.confidence - 11.0 / 12.0) < 1e-9
