"""Stochastic effects are found by their variance."""

import math
from dataclasses import replace

import numpy as np
import pytest
from measured_flights import logs, nominal, tracks

from tombo_diagnosis.flight.analyse import analyse, select_noise_fits
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.noise import (
    SCALES_S,
    block_variances,
    fit_noise_effects,
    lost_samples,
    pose_noise_statistics,
)
from tombo_diagnosis.flight.nominal import PARAMETERS
from tombo_diagnosis.flight.residual_check import (
    fit_gusts,
    noise_variances,
    residual_excesses,
    residual_variances,
)
from tombo_logs.checks import check_log

pytestmark = pytest.mark.slow

NAMES = {p.index: p.label for p in PARAMETERS}
DOUBLED = {
    "imu_noise": {"gyro": 0.02},
    "mocap_noise": {"position": 0.0014, "attitude": 0.004},
    "mocap_latency": {"jitter": 0.002},
}


@pytest.fixture(scope="module")
def healthy():
    return tracks(seed=3)


def gusts_in(flights):
    problem = FlightProblem(flights, nominal())
    left = residual_variances(problem, problem.null_hypothesis)
    return fit_gusts(problem, problem.null_hypothesis, left)


def noise_fits_of(flights):
    return select_noise_fits(fit_noise_effects(flights, nominal(), nominal().theta))


def by_label(fit):
    return {NAMES[i]: v for i, v in zip(fit.free, fit.value, strict=True)}


def test_healthy_noise_is_no_finding(healthy):
    assert noise_fits_of(healthy) == []
    assert noise_fits_of(tracks(seed=4, sensors="mocap")) == []


@pytest.mark.parametrize("effect", DOUBLED)
def test_twice_the_noise_is_found_with_its_size(effect):
    best = noise_fits_of(tracks({effect: DOUBLED[effect]}, seed=2))
    assert [fit.effect for fit in best] == [effect]
    fitted = by_label(best[0])
    for name, value in DOUBLED[effect].items():
        assert fitted[f"{effect}.{name}"] == pytest.approx(value, rel=0.12)
    assert all(d > 0.0 for d in best[0].deviation)


def test_gaps_are_found_and_their_length():
    hidden = {"mocap_dropouts": {"probability": 0.04, "duration": 0.1}}
    best = noise_fits_of(tracks(hidden, seed=2))
    assert best[0].effect == "mocap_dropouts"
    fitted = by_label(best[0])
    assert fitted["mocap_dropouts.probability"] == pytest.approx(0.04, rel=0.5)
    assert fitted["mocap_dropouts.duration"] == pytest.approx(0.1, rel=0.4)


def test_white_noise_variance_falls_with_block_length_without_drift():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((40_000, 1))
    variances, counts = block_variances(noise, 0.02)
    lengths = np.round(np.array(SCALES_S) / 0.02)
    assert variances[:, 0] * lengths == pytest.approx(np.full(len(SCALES_S), 0.5), rel=0.15)
    assert (np.diff(counts) < 0).all()
    still, _ = block_variances(noise + 100.0, 0.02)
    assert still == pytest.approx(variances)


def test_what_chance_leaves_is_what_healthy_flights_leave(healthy):
    """Every channel at every time scale, within a factor that sampling gives."""
    problem = FlightProblem(healthy, nominal())
    rest = residual_excesses(
        residual_variances(problem, problem.null_hypothesis),
        noise_variances(problem, problem.theta),
    )
    channels = [c.name for own in problem.channels[0].values() for c in own]
    assert {each.channel for each in rest} == set(channels)
    assert max(each.excess for each in rest) < 0.6
    assert [e.excess for e in rest] == sorted((e.excess for e in rest), reverse=True)


@pytest.fixture(scope="module")
def gusty():
    return tracks({"gusts": {"deviation": 0.9, "time": 0.8}}, seed=5)


def test_gusts_are_fitted_with_strength_and_time(gusty):
    fit = gusts_in(gusty)
    assert fit.stronger and fit.evidence > 10.0 and not fit.at_edge
    assert abs(fit.deviation - 0.9) < max(0.2, 3.0 * fit.deviation_error)
    assert abs(math.log(fit.time / 0.8)) < max(0.5, 3.0 * fit.time_error / fit.time)


def test_healthy_air_is_no_finding(healthy):
    assert gusts_in(healthy).evidence < 1.0


def test_gusts_are_named_by_the_whole_analysis(gusty):
    words = analyse(gusty, nominal())
    assert words.judgement.verdict == "named" and words.judgement.effects == ("gusts",)
    assert words.remainder.residual_r2 < 0.1


@pytest.mark.parametrize("unknown", ["thrust_hysteresis", "yaw_spring", "periodic_push"])
def test_a_force_that_no_effect_describes_is_not_called_gusts(unknown):
    flights = logs(disturbance=(unknown,), seed=1)
    words = analyse([track_of(log) for log in flights], nominal()).judgement
    assert words.verdict in ("unknown", "partly_explained")
    assert "gusts" not in words.effects


def test_a_late_sample_is_not_a_lost_one():
    """Stamps of arrival jitter by a third of a step; then every twentieth sample is taken out."""
    rng = np.random.default_rng(5)
    t = np.arange(2000) * 0.02
    late = t + rng.uniform(0.0, 0.012, t.size)
    assert lost_samples(np.diff(late), 0.02).sum() <= 0.01 * t.size
    kept = np.arange(t.size) % 20 != 10
    assert lost_samples(np.diff(t[kept]), 0.02).sum() == 100
    assert lost_samples(np.diff(late[kept]), 0.02).sum() == pytest.approx(100, abs=25)


def test_where_stamps_are_arrivals_no_dropout_is_told():
    (track, *_) = tracks({"mocap_dropouts": {"probability": 0.04, "duration": 0.1}}, seed=2)
    assert "gaps" in pose_noise_statistics([track])
    spacing = np.median(np.diff(track.pose_t))
    late = np.random.default_rng(1).uniform(0.0, 0.9 * spacing, track.pose_t.size)
    assert "gaps" not in pose_noise_statistics([replace(track, pose_t=track.pose_t + late)])


def test_a_wrong_pose_that_is_left_out_is_not_a_lost_one():
    """Single poses 10 cm off are taken out by the checks; the motion capture has lost none."""
    (log,) = logs(count=1, sensors="mocap", seed=3)
    position = log.series["position"]
    values = position.values.copy()
    values[200:1000:80, 1] += 0.1
    damaged = log.with_series({**log.series, "position": replace(position, values=values)})
    checked = check_log(damaged)
    assert any(f.check == "jump" for f in checked.findings)
    assert pose_noise_statistics([track_of(checked)])["gaps"][0] == 0.0


def test_gaps_of_a_flight_in_parts_are_those_of_the_flight():
    (track,) = tracks({"mocap_dropouts": {"probability": 0.04, "duration": 0.1}}, seed=2, count=1)
    half = track.pose_t > np.median(track.pose_t)
    every = np.ones(track.fast_rows.size, np.bool_), np.ones(track.slow_rows.size, np.bool_)
    whole = pose_noise_statistics([track])
    parts = pose_noise_statistics([track.only(*every, ~half), track.only(*every, half)])
    for name in ("gaps", "samples"):
        assert parts[name][0] == pytest.approx(whole[name][0], rel=0.05)
