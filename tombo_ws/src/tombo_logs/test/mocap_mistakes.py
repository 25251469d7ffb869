"""Mistakes of a motion capture, made in a flight: name of the finding → the flight with it.

Each changes stamps (N,), places (N, 3) and turns of the poses.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series

Y_UP = Rotation.from_euler("x", -90.0, degrees=True)


def about_z(degrees):
    return Rotation.from_euler("z", degrees, degrees=True)


def another_body(t, place, turn):
    rng = np.random.default_rng(1)
    lies = [1.0, 2.0, 0.3] + 2e-4 * rng.standard_normal(place.shape)
    return t, lies, Rotation.from_rotvec(2e-3 * rng.standard_normal(place.shape))


def swapped(t, place, turn):
    swap = (np.arange(t.size) > 0.4 * t.size) & (np.arange(t.size) < 0.42 * t.size)
    return t, place, turn * Rotation.from_rotvec(np.outer(swap, [0.0, 0.0, np.pi / 2.0]))


def by_arrival(t, place, turn):
    late = 0.012 + np.random.default_rng(2).exponential(0.006, t.shape)
    return np.maximum.accumulate(t + late) + 1e-7 * np.arange(t.size), place, turn


def of_rows(rows):
    return lambda t, place, turn: tuple(x[rows(t)] for x in (t, place, turn))


def eight_a_second(t):
    return np.arange(t.size) % max(round(0.125 / float(np.median(np.diff(t)))), 1) == 0


def with_gaps(t):
    begins = t[0] + (t[-1] - t[0]) * np.array([0.35, 0.5, 0.65])
    return ~((t[:, None] > begins) & (t[:, None] < begins + 0.5)).any(axis=1)


def frozen(t, place, turn):
    rows, begin = np.arange(t.size), t[0] + 0.45 * (t[-1] - t[0])
    held = (t > begin) & (t < begin + 1.0)
    rows[held] = np.argmax(held)
    return t, place[rows], turn[rows]


MISTAKES = {
    "y up": ("up_axis", lambda t, p, q: (t, Y_UP.apply(p), Y_UP * q * Y_UP.inv())),
    "body turned by 90 deg": ("body_turned", lambda t, p, q: (t, p, q * about_z(90.0))),
    "body turned by 180 deg": ("body_turned", lambda t, p, q: (t, p, q * about_z(180.0))),
    "millimetres": ("millimetres", lambda t, p, q: (t, 1e3 * p, q)),
    "another body": ("does_not_move", another_body),
    "markers swapped": ("markers_swapped", swapped),
    "stamps of arrival": ("arrival_stamps", by_arrival),
    "clock ahead": ("clock", lambda t, p, q: (t + 0.15, p, q)),
    "8 Hz": ("rate", of_rows(eight_a_second)),
    "gaps": ("gaps", of_rows(with_gaps)),
    "frozen": ("frozen", frozen),
}


def made(change, log):
    """The flight with a mistake; poses have one stamp for place and turn."""
    position, attitude = log.series["position"], log.series["attitude"]
    turns = Rotation.from_quat(attitude.values)
    t, place, turn = change(position.t, position.values, turns)
    poses = {"position": Series(t, place), "attitude": Series(t, turn.as_quat())}
    return log.with_series({**log.series, **poses})
