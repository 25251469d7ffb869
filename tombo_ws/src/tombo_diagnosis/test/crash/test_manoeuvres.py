"""A manoeuvre is never called an oscillation; a swing that nobody asks for is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.control.controller import controller_report
from tombo_diagnosis.crash.reason import why
from tombo_dynamics.vehicle import GRAVITY

STEP, LATE_S = 0.01, 0.15
POSITION, VELOCITY, STILL = "position_setpoint", "velocity_setpoint", "no feed-forward"
HEADING = "attitude_setpoint"


def eased(t, begin, end):
    x = np.clip((t - begin) / (end - begin), 0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def sound_flight(hertz, rate, *asked, across=0.0, turning=0.0, shaking=0.0, length=8.0):
    """Return a flight that follows its course after `LATE_S`, with the set points `asked`.

    It goes to and fro along x and pitches by `rate` [rad/s]; with `across` it flies an eight. Its
    heading turns by `turning` [rad/s]. A roll by `shaking` [rad/s] at 4 Hz is not asked for.
    """
    t = np.arange(0.0, length, STEP)
    w = 2.0 * np.pi * hertz
    reach = rate * GRAVITY / w**3

    def path(s):
        size = reach * eased(s, 1.0, 2.0)
        sides = across * size / 8.0 * np.sin(2.0 * w * s)
        return np.column_stack([size * np.sin(w * s), sides, np.full(s.size, 1.5)])

    place, course = path(t - LATE_S), path(t)
    speed = np.gradient(place, STEP, axis=0)
    force = np.gradient(speed, STEP, axis=0) + np.array([0.0, 0.0, GRAVITY])

    def attitude(late):
        heading = turning / w * np.sin(w * (t - late)) * eased(t - late, 1.0, 2.0)
        up = force / np.linalg.norm(force, axis=1, keepdims=True)
        left = np.cross(up, np.column_stack([np.cos(heading), np.sin(heading), 0.0 * t]))
        left /= np.linalg.norm(left, axis=1, keepdims=True)
        return Rotation.from_matrix(np.stack([np.cross(left, up), left, up], axis=2))

    turns = attitude(LATE_S)
    rates = np.zeros((t.size, 3))
    rates[1:-1] = (turns[:-2].inv() * turns[2:]).as_rotvec() / (2.0 * STEP)
    rates[:, 0] += shaking * eased(t, 4.0, 5.0) * np.sin(2.0 * np.pi * 4.0 * t)
    rng = np.random.default_rng(5)
    values = {
        "position": place + 0.0005 * rng.standard_normal(place.shape),
        "attitude": turns.as_quat(),
        "gyro": rates + 0.02 * rng.standard_normal(rates.shape),
        "accel": np.linalg.norm(force, axis=1)[:, None] * [0.0, 0.0, 1.0],
    }
    wanted = {
        POSITION: (POSITION, course),
        VELOCITY: (VELOCITY, np.gradient(course, STEP, axis=0)),
        STILL: (VELOCITY, 0.0 * course),
        HEADING: (HEADING, attitude(0.0).as_quat()),
    }
    values |= dict(wanted[name] for name in asked)
    return Flight.measured("course", "", {n: Series(t, np.array(v)) for n, v in values.items()})


def oscillates(flight):
    report = controller_report([flight], None)
    swings = report is not None and report.oscillations
    return why(flight).cause == "oscillation" or bool(swings)


@pytest.mark.parametrize("asked", [(), (POSITION,), (POSITION, VELOCITY), (POSITION, STILL),
                                   (STILL,), (POSITION, HEADING)])  # fmt: skip
@pytest.mark.parametrize("across", [0.0, 1.0], ids=["sine", "eight"])
@pytest.mark.parametrize(("hertz", "rate"), [(0.95, 1.5), (1.3, 3.0), (1.6, 3.0)])
def test_a_course_that_is_asked_for_is_no_oscillation(hertz, rate, across, asked):
    assert not oscillates(sound_flight(hertz, rate, *asked, across=across))


@pytest.mark.parametrize("asked", [(), (POSITION, HEADING), (POSITION, VELOCITY)])
def test_a_heading_that_is_asked_for_is_no_oscillation(asked):
    assert not oscillates(sound_flight(1.3, 0.5, *asked, turning=2.0))


@pytest.mark.parametrize("asked", [(), (POSITION, VELOCITY), (POSITION, STILL)])
def test_a_swing_that_nobody_asks_for_is_an_oscillation(asked):
    assert oscillates(sound_flight(0.95, 0.5, *asked, shaking=4.0))


def test_a_flight_too_short_for_set_points_has_its_course_too():
    assert why(sound_flight(1.3, 3.0, length=2.0)).cause == "none"
