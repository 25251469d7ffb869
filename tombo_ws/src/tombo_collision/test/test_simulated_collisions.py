"""Detector, reaction and mission in whole simulated flights, with every trigger."""

import math

import numpy as np
import pytest

from tombo_dynamics.messages import Phase
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import load_scenario

SEEDS = range(100, 112)
MEMORY = Workspace()


def fly_seeds(name, *settings, seeds=SEEDS):
    scenario = load_scenario(name, settings)
    for seed in seeds:
        yield scenario, fly_scenario(scenario, seed, MEMORY)


def detections(record):
    return [e for e in record.events if e["kind"] == "detection"]


@pytest.mark.slow
def test_it_knows_where_when_and_whither_it_collided():
    where, whither, when = [], [], []
    for scenario, record in fly_seeds("paper_collision"):
        tick = round(record.summary["collision_time_s"] * 1e3)
        event = detections(record)[0]
        x_c, n_r = np.array(event["x_c_m"]), np.array(record.summary["n_r"])
        velocity = record.log["velocity"][tick]
        ahead = velocity / np.linalg.norm(velocity)
        where.append(np.linalg.norm(x_c - record.log["position"][tick]))
        whither.append(math.acos(min(ahead @ event["flight_direction"], 1.0)))
        when.append(abs(event["contact_time_s"] - tick * 1e-3))
        assert n_r @ ahead < -0.99
        x_r = x_c + scenario.reaction.distance * n_r
        assert record.summary["x_r_m"] == pytest.approx(x_r.tolist(), abs=1e-5)
    assert max(where) < 0.02
    assert max(whither) < 0.05
    assert max(when) < 1.0 / 30.0


@pytest.mark.slow
def test_a_known_region_alone_fires_once_and_inside_before_the_strike():
    for scenario, record in fly_seeds("known_obstacle"):
        p = scenario.detector
        events = detections(record)
        assert [e["trigger"] for e in events] == ["region"]
        off = np.array(events[0]["x_c_m"]) - [p.region_x, p.region_y, p.region_z]
        ahead = np.array(events[0]["flight_direction"])
        along = off @ ahead
        assert abs(along) < p.region_depth
        assert np.linalg.norm(off - along * ahead) < p.region_radius
        latency = record.summary["detection_latency_s"]
        if latency is not None and record.summary["collided"]:
            early = p.region_depth / scenario.mission.approach_speed
            assert -1.5 * early < latency < 0.05


@pytest.mark.slow
def test_gaps_of_mocap_are_sat_out_level_and_are_no_collisions():
    gaps = ("effects.mocap_dropouts.probability=0.005", "effects.mocap_dropouts.duration=0.5")
    spells = 0
    for _, record in fly_seeds("no_obstacle", *gaps, seeds=range(6)):
        blind = record.log["mode"][:, 0] == Phase.DESCEND_BLIND
        spells += int((np.diff(blind.astype(int)) == 1).sum())
        assert not record.summary["crashed"]
        assert record.summary["landed"]
        assert record.summary["false_alarms"] == 0
        assert record.summary["max_tilt_rad"] < 0.4
    assert spells > 5


@pytest.mark.slow
def test_an_unknown_obstacle_is_detected_in_time_and_never_too_early():
    summaries = [record.summary for _, record in fly_seeds("paper_collision", seeds=range(40))]
    latency = [s["detection_latency_s"] for s in summaries]
    assert np.percentile(latency, 95) <= 0.120
    assert min(latency) > 0.0
    assert sum(s["false_alarms"] for s in summaries) == 0
    assert max(s["hover_rms_m"] for s in summaries) <= 0.05
    assert max(s["approach_rms_m"] for s in summaries) <= 0.15


@pytest.mark.slow
@pytest.mark.parametrize(("share", "alarms"), [(1.0, False), (0.5, False), (0.08, True)])
def test_no_jump_and_no_gust_is_an_alarm_unless_the_threshold_is_tiny(share, alarms):
    threshold = share * load_scenario().detector.threshold
    settings = ("reaction.name=none", f"detector.threshold={threshold}")
    flights = fly_seeds("aggressive", *settings, seeds=range(20))
    assert (sum(record.summary["false_alarms"] for _, record in flights) > 0) is alarms
