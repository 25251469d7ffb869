"""A course of a file: its polynomials, its errors, and the mission that flies it."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_control.planning.leg import leg_position
from tombo_control.planning.mission import MissionParams, advance_mission, begin, compiled_plan
from tombo_control.planning.mission import resume as resume_mission
from tombo_control.planning.mission_memory import MissionMemory
from tombo_control.planning.timed_course import (
    course_pieces,
    piece_reference,
    sampled_course,
    timed_course_text,
)
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase

PERIOD_S = 0.02
HOVER_AT = np.array([0.0, 0.0, 1.5])


def circle(t: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(t), 1.0 - np.cos(t), 1.5 + 0.2 * np.sin(2.0 * t)], axis=-1)


def samples(columns: int) -> str:
    """A circle at 10 Hz with the first columns of t, position, velocity, acceleration, yaw."""
    t = np.linspace(0.0, 6.0, 61)
    v = np.stack([np.cos(t), np.sin(t), 0.4 * np.cos(2.0 * t)], axis=-1)
    a = np.stack([-np.sin(t), np.cos(t), -0.8 * np.sin(2.0 * t)], axis=-1)
    yaw = np.remainder(t + np.pi, 2.0 * np.pi) - np.pi  # wraps at 3.14 s
    names = "t [s],x [m],y [m],z [m],vx [m/s],vy [m/s],vz [m/s],ax,ay,az,yaw [rad]"
    table = np.column_stack([t, circle(t), v, a, yaw])[:, :columns]
    rows = [",".join(f"{value:.9f}" for value in row) for row in table]
    return "\n".join([",".join(names.split(",")[:columns]), *rows]) + "\n"


@pytest.mark.parametrize(("columns", "worst"), [(4, 2e-4), (7, 1e-4), (10, 1e-6), (11, 1e-6)])
def test_samples_are_joined_by_a_smooth_curve(columns: int, worst: float) -> None:
    _, t, position, velocity, _ = sampled_course(course_pieces(samples(columns), 1.5), 0.01)
    assert np.abs(position[:, :3] - circle(t)).max() < worst
    assert np.abs(velocity[:, 0] - np.cos(t)).max() < 100.0 * worst
    if columns == 11:
        assert np.abs(position[:, 3] - t).max() < 1e-3  # a whole turn, not wrapped


def test_polynomials_of_crazyswarm2_begin_at_the_hover() -> None:
    names = ["duration", *(f"{axis}^{k}" for axis in ("x", "y", "z", "yaw") for k in range(8))]
    c = np.zeros((2, 33))
    c[:, 0] = 2.0
    c[0, 1:5] = 0.3, 0.0, 0.5, -0.1  # x
    c[1, 1] = c[0, 1:5] @ 2.0 ** np.arange(4)
    text = "\n".join([",".join(names), *(",".join(map(str, row)) + "," for row in c)])
    pieces = course_pieces(text, 1.5)
    reference = piece_reference(pieces, 0, 1.0)
    assert reference.position == pytest.approx((0.4, 0.0, 1.5))
    assert reference.velocity == pytest.approx((0.7, 0.0, 0.0))
    assert reference.acceleration == pytest.approx((0.4, 0.0, 0.0))
    assert piece_reference(pieces, 1, 3.0).position == pytest.approx((1.2, 0.0, 1.5))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("t,x,y,z\n0,0,0,1\n1,0,0,1\n1,0,0,1\n", "row 4: t 1 s after 1 s"),
        ("t,x,y,z\n0,0,0,1\n1,0,,1\n", "row 3"),
        ("t [ms],x,y,z\n0,0,0,1\n1,0,0,1\n", "t [s]"),
        ("t,x,y,z,vx\n0,0,0,1,0\n1,0,0,1,0\n", "columns"),
        ("t,x,y,height\n0,0,0,1\n1,0,0,1\n", "column 'height'"),
        ("t,x,y,z\n", "0 rows"),
    ],
)
def test_a_wrong_table_is_refused_by_its_row(text: str, named: str) -> None:
    with pytest.raises(InputError) as error:
        timed_course_text("mission.course", text)
    assert named in str(error.value)
    assert str(error.value).startswith("mission.course: ") and "accepted: " in str(error.value)


def test_the_mission_follows_it_goes_back_after_a_push_and_lands() -> None:
    params = MissionParams(
        takeoff_time=0.1, height=1.5, climb_speed=1.5, approach_time=2.5, land_time=60.0,
        course=samples(4),
    )  # fmt: skip
    plan = compiled_plan(params)
    state = MissionMemory.new()
    begin(state, np.array([0.0, 0.0, 0.18]))
    here, began, pushed = HOVER_AT, None, False
    for k in range(1, 1000):
        now = k * PERIOD_S
        if state.mode == Phase.APPROACH and state.steps == 31 and not pushed:
            pushed, aside = True, np.array([2.0, 1.0, 1.5])
            resume_mission(state, plan, now, aside)
            assert leg_position(state.leg, now) == pytest.approx(aside)
        advance_mission(state, plan, now, here, np.zeros(3))
        here = np.array(leg_position(state.leg, now)) if state.mode != Phase.TAKEOFF else HOVER_AT
        if state.mode == Phase.LAND:
            break
        if state.mode == Phase.APPROACH and state.leg.ramp_s == 0.0:
            began = state.course_s if began is None else began
            assert here == pytest.approx(circle(np.array(now - state.course_s)), abs=1e-3)
    assert state.mode == Phase.LAND and pushed
    assert began is not None and state.course_s > began + 1.0  # the duration of the way back
    assert now == pytest.approx(state.course_s + 6.0, abs=2.0 * PERIOD_S)
