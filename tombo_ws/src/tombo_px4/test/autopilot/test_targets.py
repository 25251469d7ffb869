"""Set points of OFFBOARD: what each combination means axis by axis, and what is refused."""

import itertools
import math

import numpy as np
import pytest
from vehicle_bench import NAN, motion

from tombo_px4.autopilot.setpoint_controller import (
    ControlLevel,
    OffboardSetpoint,
    ResolvedSetpoint,
    resolve_setpoint,
)

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
EAST_90 = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
"""Nose to the north: yaw 90 deg."""


def demand(target: OffboardSetpoint, attitude=LEVEL) -> ResolvedSetpoint:
    resolved = resolve_setpoint(target, attitude)
    assert isinstance(resolved, ResolvedSetpoint), resolved
    return resolved


def refusal(target: OffboardSetpoint) -> str:
    resolved = resolve_setpoint(target, LEVEL)
    assert isinstance(resolved, str), resolved
    return resolved


def test_each_kind_is_the_outermost_loop_that_is_commanded():
    assert demand(motion([1, 2, 3])).kind == ControlLevel.POSITION
    assert demand(motion(velocity=[1, 2, 3])).kind == ControlLevel.VELOCITY
    assert demand(motion(push=[1, 2, 3])).kind == ControlLevel.ACCELERATION
    assert demand(motion([NAN, NAN, 3], [1, 2, NAN])).kind == ControlLevel.POSITION
    assert demand(OffboardSetpoint(attitude=LEVEL, thrust=0.5)).kind == ControlLevel.ATTITUDE
    assert demand(OffboardSetpoint(rates=np.zeros(3), thrust=0.5)).kind == ControlLevel.RATES


def test_which_axes_may_be_left_out():
    """PX4: every axis needs something, and x and y are commanded alike."""
    for commanded in itertools.product([False, True], repeat=9):
        values = np.where(np.reshape(commanded, (3, 3)), 1.0, NAN)
        resolved = resolve_setpoint(motion(*values), LEVEL)
        by_axis = np.isfinite(values).any(axis=0)
        alike = (np.isfinite(values[:, 0]) == np.isfinite(values[:, 1])).all()
        accepted = bool(by_axis.all() and alike)
        assert isinstance(resolved, ResolvedSetpoint) == accepted, values


def test_the_body_frame_turns_with_the_heading_and_knows_no_position():
    d = demand(motion([9, 9, 9], [1, 0, 0.5], [0, 1, 0], frame="body"), EAST_90)
    np.testing.assert_allclose(d.velocity, [0, 1, 0.5], atol=1e-12)
    np.testing.assert_allclose(d.acceleration, [-1, 0, 0], atol=1e-12)
    assert np.isnan(d.position).all() and d.kind == ControlLevel.VELOCITY


@pytest.mark.parametrize(
    ("target", "why"),
    [
        (OffboardSetpoint(), "nothing"),
        (motion(velocity=[1, 1, 1], frame="moon"), "frame moon unsupported"),
        (motion([1, 2, NAN]), "axis is not commanded"),
        (motion([1, NAN, 2], [NAN, 1, NAN]), "x and y differ"),
        (motion([9, 9, 9], frame="body"), "axis is not commanded"),
        (OffboardSetpoint(attitude=LEVEL), "no thrust"),
        (OffboardSetpoint(rates=np.zeros(3)), "no thrust"),
        (OffboardSetpoint(attitude=np.zeros(4), thrust=0.5), "no unit quaternion"),
        (OffboardSetpoint(attitude=np.full(4, NAN), thrust=0.5), "not finite"),
        (OffboardSetpoint(rates=np.zeros(2), thrust=0.5), "wrong shape"),
        (motion([1, 2]), "wrong shape"),
        (OffboardSetpoint(thrust=0.5), "nothing"),
        (motion([1e6, 0, 0]), "out of range"),
        (motion(velocity=[0, 0, 0], yaw_rate=1e3), "out of range"),
        (OffboardSetpoint(rates=np.array([0, 0, 1e3]), thrust=0.5), "out of range"),
    ],
)
def test_refused_with_the_reason(target, why):
    assert why in refusal(target)
