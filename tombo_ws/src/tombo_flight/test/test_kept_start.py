"""Flights that begin in flight, in the state in which another was."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import load_scenario, world_of

EARLY = ("mission.takeoff_time=0.2", "mission.climb_speed=1.2", "mission.approach_time=4")
"""The paper's collision after 7 s."""
WITHOUT_NOISE = (
    *("mocap_noise.position=0", "mocap_noise.attitude=0", "mocap_latency.jitter=0"),
    *("imu_noise.gyro=0", "imu_noise.accel=0", "gusts.deviation=0"),
)
CUT = ("start.time=6.8", "duration=9")


def scenario(*settings: str):
    return load_scenario("paper_collision", [*EARLY, *settings])


@pytest.mark.slow
def test_without_noise_the_rest_of_a_flight_is_that_of_the_whole_to_the_last_bit():
    """So nothing of vehicle, sensors and cores is lost where it begins again."""
    still = [f"effects.{setting}" for setting in WITHOUT_NOISE]
    space = Workspace()
    for more in ((), ("obstacle.y=0.25", "effects.blade_strike.recovery_time=0.5")):
        whole = fly_scenario(scenario(*still, "duration=9", *more), 0)
        rest = fly_scenario(scenario(*still, *CUT, *more), 0, space)
        assert rest.t[0] == 6.8 and rest.summary["collided"]
        assert rest.summary["collision_time_s"] == whole.summary["collision_time_s"]
        for name, values in rest.log.items():
            assert np.array_equal(values, whole.log[name][-values.shape[0] :]), name
        for topic in ("/odometry", "/reaction/status", "/mocap/pose"):
            late = whole[topic].t >= 7.0
            assert np.array_equal(rest[topic].t[rest[topic].t >= 7.0], whole[topic].t[late])


@pytest.mark.slow
def test_all_seeds_begin_in_the_states_that_are_kept_and_differ_after():
    space, cut = Workspace(), scenario(*CUT, "start.states=2")
    flown = [fly_scenario(cut, seed, space).log["position"].copy() for seed in range(4)]
    whole = [fly_scenario(scenario("duration=9"), seed).log["position"][6800] for seed in (0, 1)]
    assert np.array_equal([positions[0] for positions in flown], [*whole, *whole])
    assert len({positions[-1, 2] for positions in flown}) == 4
    assert np.array_equal(fly_scenario(cut, 3).log["position"], flown[3])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (("start.time=6.8", "duration=6"), "less than duration"),
        (("start.time=7.2", "duration=9"), "start.time: .*does not start inside"),
        (("start.time=2.0", "duration=9", "start.states=0"), "start.states"),
    ],
)
def test_a_start_that_can_not_be_is_refused(settings: tuple[str, ...], said: str):
    with pytest.raises(InputError, match=said):
        fly_scenario(scenario(*settings), 0)


def test_nodes_do_not_begin_in_flight():
    with pytest.raises(InputError, match=r"start\.time 6\.8: accepted: 0"):
        world_of(scenario(*CUT))
