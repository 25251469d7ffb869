"""How sure the answer is that nothing is wrong: sounder than even, not as sure as its signs."""

import numpy as np

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.crash.reason import why


def flight(fallen_m):
    t = np.arange(0.0, 6.0, 0.01)
    noise = 0.0005 * np.random.default_rng(5).standard_normal((t.size, 3))
    place = np.column_stack([0.1 * np.sin(t), 0.1 * np.cos(t), np.full(t.size, 3.0)])
    since = np.clip(t - 4.0, 0.0, 0.5)
    place[:, 2] -= fallen_m * (since / 0.5) ** 2
    return Flight.measured("flight", "", {"position": Series(t, place + noise)})


def test_a_log_without_a_sign_may_be_of_a_mishap_that_leaves_none():
    """7 of 19 real mishaps left none: 8 of 21 by Laplace, so 21 of 29 such logs are sound."""
    sound, fallen = why(flight(0.0)), why(flight(1.2))
    assert sound.cause == "none" and abs(sound.confidence - 21.0 / 29.0) < 1e-9
    assert fallen.cause != "none"
