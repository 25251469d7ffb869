"""The study of the threshold: its arithmetic, and that the chosen threshold does what is asked."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tombo_benchmarks.detector_threshold_study import (
    REQUIRED_LATENCY_S,
    THRESHOLDS,
    DetectorTrace,
    draw_study,
    evaluate_threshold,
    record_traces,
)
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import load_scenario

PAPER = load_scenario()
CHOSEN = PAPER.detector.threshold
HOLDOFF = PAPER.detector.holdoff
MEMORY = Workspace()


def made(statistic, contact=math.inf, late=0.01):
    stamp = np.arange(len(statistic)) * 0.1
    return DetectorTrace(stamp, stamp + late, np.array(statistic, dtype=float), contact)


def test_latency_is_from_contact_to_the_first_sample_above():
    outcome = evaluate_threshold([made([1, 1, 1, 5, 9, 99], contact=0.25)], 4.0, 1.0)
    assert outcome.latency == pytest.approx([0.06])
    assert (
        evaluate_threshold([made([1, 1, 1, 5, 9, 99], contact=0.25)], 8.0, 1.0).latency[0] > 0.15
    )
    assert (outcome.missed, outcome.early, outcome.false_alarms) == (0, 0, 0)


def test_a_strike_that_is_never_found_is_missed_and_infinitely_late():
    found = [made([1, 1, 9, 9], contact=0.15)] * 19
    outcome = evaluate_threshold([*found, made([1, 1, 1, 1], contact=0.15)], 4.0, 1.0)
    assert outcome.missed == 1
    assert outcome.latency_ms(95.0) == pytest.approx(60.0)
    assert math.isinf(outcome.latency_ms(96.0))
    much_later = made([1, 1, *[1] * 10, 9], contact=0.15)
    assert evaluate_threshold([much_later], 4.0, 1.0).missed == 1


def test_false_alarms_are_counted_by_events_not_by_samples():
    noisy = made([1, 9, 9, 9, 9, 9, 9, 1, 1, 9])
    assert evaluate_threshold([noisy], 4.0, 0.35).false_alarms == 3
    assert evaluate_threshold([noisy], 4.0, 5.0).false_alarms == 1
    assert evaluate_threshold([noisy], 4.0, 0.35).false_alarms_per_minute == pytest.approx(
        3 / (0.9 / 60.0)
    )


def test_an_event_before_contact_is_early_and_one_after_is_not_an_alarm():
    outcome = evaluate_threshold([made([1, 9, 1, 1, 9, 9], contact=0.35)], 4.0, 1.0)
    assert (outcome.early, outcome.false_alarms) == (1, 1)
    assert outcome.latency == pytest.approx([0.06])
    assert outcome.minutes == pytest.approx(0.4 / 60.0)


def test_time_on_the_ground_is_not_watched():
    assert evaluate_threshold([made([0, 0, 0, 1, 1, 1])], 4.0, 1.0).minutes == pytest.approx(
        0.2 / 60.0
    )


def test_the_figure_is_drawn_from_any_outcomes():
    outcomes = [
        evaluate_threshold([made([1, 9, 1], contact=0.05)], float(t), 1.0) for t in THRESHOLDS
    ]
    free = [evaluate_threshold([made([1, 9, 1])], float(t), 1.0) for t in THRESHOLDS]
    figure = draw_study({"paper": outcomes}, {"calm": free, "noisy": free}, CHOSEN)
    assert len(figure.axes) == 3


@pytest.mark.slow
def test_the_study_sees_what_the_detector_does():
    """Flown with the triggers off and judged afterwards, or flown with them on: the same."""
    seeds = range(200, 206)
    for watch in record_traces(PAPER, seeds[:2], MEMORY):
        assert (watch.statistic[watch.stamp < 2.0] == 0.0).all()  # not armed yet
        hovering = (watch.stamp > 6.0) & (watch.stamp < 20.0)
        assert watch.statistic[hovering].min() > 0.0
    for threshold in (20.0, CHOSEN, 150.0):
        scenario = replace(PAPER, detector=replace(PAPER.detector, threshold=threshold))
        studied = evaluate_threshold(
            record_traces(PAPER, seeds, MEMORY), threshold, HOLDOFF
        ).latency
        flown = [
            fly_scenario(scenario, seed, MEMORY).summary["detection_latency_s"] for seed in seeds
        ]
        assert studied == pytest.approx(flown, abs=1e-6)


@pytest.fixture(scope="module")
def collisions():
    return [fly_scenario(PAPER, seed, MEMORY).summary for seed in range(40)]


@pytest.mark.slow
def test_an_unknown_obstacle_is_found_in_time_and_never_too_early(collisions):
    hit = [s for s in collisions if s["collided"]]
    late = [s["detection_latency_s"] for s in hit if s["detected"]]
    assert len(hit) == len(late) == 40
    assert np.percentile(late, 95) <= REQUIRED_LATENCY_S
    assert min(late) > 0.0
    assert sum(s["false_alarms"] for s in collisions) == 0


@pytest.mark.slow
def test_it_is_on_the_spot_before_contact(collisions):
    assert max(s["hover_rms_m"] for s in collisions) <= 0.05
    assert max(s["approach_rms_m"] for s in collisions) <= 0.15


@pytest.mark.slow
def test_no_false_alarm_in_forty_aggressive_flights():
    aggressive = load_scenario("aggressive")
    watches = record_traces(aggressive, range(40), MEMORY)
    outcome = evaluate_threshold(watches, CHOSEN, HOLDOFF)
    assert outcome.false_alarms == 0
    assert outcome.minutes > 24.0
    # and none with half the threshold either
    assert evaluate_threshold(watches, 0.5 * CHOSEN, HOLDOFF).false_alarms == 0
    # the flights are a test: with a threshold of a few they do raise alarms
    assert evaluate_threshold(watches, 5.0, HOLDOFF).false_alarms > 8
