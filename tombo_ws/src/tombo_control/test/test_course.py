"""A mission along waypoints: read and checked, flown to each, turning and holding, then landed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mission_bench import HOME, Follower, World

from tombo_control.planning.course import read_course, resolved_waypoint, waypoint_table
from tombo_control.planning.leg import leg_position, motion_end
from tombo_control.planning.mission import MissionParams, advance_mission, compiled_plan
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase, ReactionPhase

HOVERING = (0.1, -0.2, 1.2)
LEGS = [
    {"x": 1.5, "yaw": 1.5, "speed": 1.0, "hold": 0.5},
    {"y": 1.0, "speed": 2.0, "acceleration": 2.0, "hold": 0.1},
    {"yaw": -1.5},
    {"x": 0.0, "y": 0.0, "z": 0.4, "hold": 1.0},
]


def plan_of(course, **more):
    settings = {"height": 1.2, "approach_time": 5.0, "land_time": 1000.0, "takeoff_time": 0.5}
    return MissionParams(**{**settings, **more}, course=read_course("course", course))


def resolved_waypoints(course, hover, speed):
    table = waypoint_table(course)
    return [resolved_waypoint(table, row, hover, speed) for row in range(len(table))]


@pytest.mark.slow
def test_flies_to_every_waypoint_turns_and_holds_there_and_lands():
    plan = plan_of(LEGS)
    flight = Follower(plan).run()
    assert flight.state.mode == Phase.LANDED
    now, mode, steps = flight.column(0), flight.column(1), flight.column(4)
    place, yaw = flight.column(2), flight.column(3)
    assert mode[steps > 0].max() == Phase.LANDED
    targets = resolved_waypoints(plan.course, HOVERING, plan.approach_speed)
    for i, target in enumerate(targets):
        last = np.flatnonzero((steps == i + 1) & (mode == Phase.APPROACH))[-1]
        assert place[last] == pytest.approx(target[:3], abs=1e-6)
        assert yaw[last] == pytest.approx(target.yaw, abs=1e-6)
        there = np.linalg.norm(place - target[:3], axis=1) < 1e-6
        held = (
            there & (np.abs(yaw - target.yaw) < 1e-6) & (steps == i + 1) & (mode == Phase.APPROACH)
        )
        assert np.ptp(now[held]) == pytest.approx(target.hold, abs=2.1 * flight.step)
    down = yaw[np.isin(mode, (Phase.LAND, Phase.LANDED))]
    assert len(down) > 20
    assert down == pytest.approx(-1.5, abs=1e-9), "the last heading is kept until the floor"


def test_what_a_waypoint_leaves_out_is_as_before():
    resolved = resolved_waypoints(
        read_course("c", [{}, {"speed": 2.0, "yaw": 1.0}, {"x": 3.0}]), HOVERING, 0.7
    )
    assert resolved[0] == (*HOVERING, 0.0, 0.7, 0.8, 1.0, 0.0)
    assert resolved[1] == (*HOVERING, 1.0, 2.0, 0.8, 1.0, 0.0)
    assert resolved[2] == (3.0, *HOVERING[1:], 1.0, 2.0, 0.8, 1.0, 0.0)


def test_a_late_look_begins_the_next_leg_then_and_nothing_jumps():
    plan = plan_of([{"x": 1.0}, {"x": 0.0}])
    flight = Follower(plan).run(5.1)
    late = motion_end(flight.state.leg) + flight.state.leg.hold_s + 3.0
    here = np.array(leg_position(flight.state.leg, late))
    state = flight.state
    advance_mission(state, compiled_plan(plan), late, here, np.zeros(3))
    assert state.steps == 2
    assert state.leg.begin_s == late
    assert leg_position(state.leg, late) == pytest.approx(here)


waypoints = st.fixed_dictionaries(
    {},
    optional={
        "x": st.floats(-3.0, 3.0),
        "y": st.floats(-3.0, 3.0),
        "z": st.floats(0.3, 3.0),
        "yaw": st.floats(-9.0, 9.0),
        "speed": st.floats(0.3, 8.0),
        "acceleration": st.floats(0.3, 6.0),
        "yaw_rate": st.floats(0.3, 5.0),
        "hold": st.floats(0.0, 2.0),
    },
)


@pytest.mark.slow
@given(st.lists(waypoints, min_size=1, max_size=8))
def test_any_course_is_finite_smooth_and_ends_on_the_floor(course):
    plan = plan_of(course)
    flight = Follower(plan, step=0.02).run()
    assert flight.state.mode == Phase.LANDED
    assert flight.state.steps == len(course)
    on = flight.column(1) == Phase.APPROACH
    place, yaw = flight.column(2)[on], flight.column(3)[on]
    assert np.isfinite(place).all() and np.isfinite(yaw).all()
    targets = resolved_waypoints(plan.course, HOVERING, plan.approach_speed)
    fastest, turned = max(t.speed for t in targets), max(t.yaw_rate for t in targets)
    hardest = max(t.acceleration for t in targets)
    velocity = np.diff(place, axis=0) / 0.02
    assert np.linalg.norm(velocity, axis=1).max(initial=0.0) <= fastest + 1e-6
    assert np.abs(np.diff(yaw) / 0.02).max(initial=0.0) <= turned + 1e-6
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / 0.02
    assert change.max(initial=0.0) <= 3.0 * hardest + 1e-6  # braking, the next leg, seen late


def test_a_course_that_was_held_up_goes_on_where_it_stopped():
    world = World(plan=plan_of(LEGS)).until(Phase.APPROACH).run(2.5)
    steps, place, yaw = world.course.state.steps, world.place.copy(), world.setpoints[-1].yaw
    world.reaction(ReactionPhase.HOLDING)
    world.run(3.0)
    assert world.course.state.steps == steps
    assert world.place == pytest.approx(place, abs=0.06)
    assert world.setpoints[-1].yaw == pytest.approx(yaw, abs=0.05)
    world.reaction(ReactionPhase.IDLE)
    world.until(Phase.LANDED)
    places = np.array([setpoint.position for setpoint in world.setpoints])
    for target in resolved_waypoints(read_course("c", LEGS), HOVERING, 0.7):
        assert np.linalg.norm(places - target[:3], axis=1).min() < 1e-3
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.05


def test_low_flight_along_a_course_is_no_landing():
    world = World(plan=plan_of([{"z": 0.3, "hold": 8.0}, {"x": 1.0}])).run(9.0)
    assert world.place[2] == pytest.approx(0.3, abs=0.01)
    for _ in range(150):  # it hangs a little below its reference
        world.place, world.velocity = np.array([*HOME[:2], 0.27]), np.zeros(3)
        world.run(0.02)
    world.until(Phase.LAND)
    assert world.place[0] == pytest.approx(1.0, abs=0.02)


BAD = [
    ([], "c: 0 waypoints"),
    ([{}] * 501, "c: 501 waypoints"),
    ("x", "c: 'x' can't be read"),
    ([{}, 4], r"c\[1\]: 4 is not a mapping"),
    ([{"sped": 1.0}], r"key in c\[0\].*'sped'.*speed"),
    ([{}, {}, {}, {"speed": 0.0}], r"c\[3\]\.speed: 0.0 is out of bounds"),
    ([{"speed": math.nan}], r"c\[0\]\.speed: nan"),
    ([{"z": -1.0}], r"c\[0\]\.z: -1.0 is out of bounds; accepted: .* 0.3"),
    ([{"yaw": "east"}], r"c\[0\]\.yaw: 'east'"),
    ([{"hold": -0.1}], r"c\[0\]\.hold"),
    ([{1: 2.0}], r"key in c\[0\]"),
]


@pytest.mark.parametrize(("given_course", "words"), BAD, ids=[words for _, words in BAD])
def test_a_bad_course_is_refused_by_name(given_course, words):
    with pytest.raises(InputError, match=words) as caught:
        read_course("c", given_course)
    assert "\n" not in str(caught.value)
