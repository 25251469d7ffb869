"""Set points of OFFBOARD: meaning of each combination by axis, and refused masks."""

import itertools

import numpy as np
import pytest
from vehicle_bench import NAN, motion

from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint, refusal_of

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def test_which_axes_may_be_left_out():
    """PX4: every axis needs something, and x and y are commanded alike."""
    for commanded in itertools.product([False, True], repeat=9):
        values = np.where(np.reshape(commanded, (3, 3)), 1.0, NAN)
        by_axis = np.isfinite(values).any(axis=0)
        alike = (np.isfinite(values[:, 0]) == np.isfinite(values[:, 1])).all()
        assert (refusal_of(motion(*values)) == "") == bool(by_axis.all() and alike), values


@pytest.mark.parametrize(
    ("target", "why"),
    [
        (OffboardSetpoint(), "nothing"),
        (motion([1, 2, NAN]), "axis is not commanded"),
        (motion([1, NAN, 2], [NAN, 1, NAN]), "x and y differ"),
        (OffboardSetpoint(attitude=LEVEL), "no thrust"),
        (OffboardSetpoint(attitude=np.zeros(4), thrust=0.5), "no unit quaternion"),
        (OffboardSetpoint(attitude=np.full(4, NAN), thrust=0.5), "not finite"),
        (OffboardSetpoint(thrust=0.5), "nothing"),
        (motion([1e6, 0, 0]), "out of range"),
    ],
)
def test_refused_with_the_reason(target, why):
    assert why in refusal_of(target)
