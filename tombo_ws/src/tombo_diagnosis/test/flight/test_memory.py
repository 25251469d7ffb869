"""Effects with a memory: their state follows the measured motion."""

import numpy as np
import pytest
from measured_flights import BEGIN, LIVELY, SLOW, as_log, fly, logs, nominal, with_hidden

from tombo_diagnosis.engine.model_selection import search
from tombo_diagnosis.flight.analyse import analyse
from tombo_diagnosis.flight.causes import estimate_cause
from tombo_diagnosis.flight.fit.prediction import motion_of
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.sensitivity import linearize
from tombo_diagnosis.flight.fit.track import TICK, smoothed, track_of

MASS = 0.09


def loaded(course, length, seed=7):
    """Return a flight with a load on a thread, and its log."""
    flown = fly(with_hidden({"hanging_load": {"mass": MASS}}), course, seed, length)
    return flown, as_log(flown)


def test_smoothing_keeps_what_is_curved():
    t = np.arange(0.0, 6.0, TICK)
    curved = np.column_stack([t**3 - 2.0 * t**2, np.sin(4.0 * t)])
    inner = slice(250, -250)
    off = (smoothed(curved, 0.055 / TICK) - curved)[inner]
    assert np.abs(off[:, 0]).max() < 1e-9 and np.abs(off[:, 1]).max() < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("sensors", ["imu_rpm", "mocap_rpm"])
def test_the_motion_has_less_noise_than_the_poses(sensors):
    flown = fly(with_hidden({}), LIVELY[0], seed=7)
    track = track_of(as_log(flown, sensors=sensors))
    motion = motion_of(track, nominal(), nominal().theta)
    counts = (track.t > BEGIN) & (track.t < track.t[-1] - 1.0)
    true = [np.interp(track.t, flown.t, axis) for axis in flown.log["position"].T]
    off = motion.state[counts, :3] - np.transpose(true)[counts]
    raw = motion.position[counts] - np.transpose(true)[counts]
    assert off.std() < 0.7 * raw.std()


@pytest.mark.slow
def test_a_load_in_a_slow_flight_is_found_with_its_size():
    """Noise of the poses that pulls at the thread would make it come out a third too small."""
    flights = logs({"hanging_load": {"mass": MASS}}, courses=SLOW, length=30.0)
    problem = FlightProblem([track_of(log) for log in flights], nominal())
    best = search(problem).best
    assert best.effects[:1] == ("hanging_load",)
    p = next(p for p in nominal().parameters if p.label == "hanging_load.mass")
    (place,) = problem.unknowns.places([p.index])
    deviation = np.sqrt(best.fit.solution.covariance[place, place])
    assert abs(best.fit.theta[p.index] - MASS) < max(2.5 * deviation, 0.05 * MASS)


SHUTTLES = [
    {"x": 0.5, "speed": 2.5, "acceleration": 5.0},
    *({"x": place} for place in (-0.3, 0.3, -0.3, 0.3, -0.3, 0.3, -0.3, 0.3, -0.3, 0.3)),
    *({"y": place} for place in (0.3, -0.3, 0.3, -0.3, 0.3, -0.3, 0.3)),
]
"""At the load's own period: it is thrown up, and falls back into its thread."""


@pytest.mark.slow
def test_a_load_that_was_thrown_up_is_followed_until_then():
    flown, log = loaded(SHUTTLES, 30.0)
    where = linearize(track_of(log), nominal(), nominal().theta).lost
    assert BEGIN < where["hanging_load"] < flown.t[-1] - 5.0
    quiet = linearize(track_of(loaded(SLOW[0], 30.0)[1]), nominal(), nominal().theta).lost
    assert quiet == {}


@pytest.mark.slow
def test_what_a_lost_load_does_is_set_apart():
    flights = [track_of(loaded(SHUTTLES, 30.0, seed)[1]) for seed in (7, 8, 9)]
    findings = analyse(flights, nominal())
    assert findings.judgement.effects[:1] == ("hanging_load",)
    assert {each.check for each in findings.remainder.excluded} == {"memory"}
    mass = estimate_cause("hanging_load", findings, findings.search.best).theta[0]
    assert mass.low < MASS < mass.high
