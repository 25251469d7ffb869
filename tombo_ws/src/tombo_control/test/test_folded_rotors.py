"""Allocation with a limit for each rotor: thrust that the rotors give, and the order of
priorities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_control.autopilot import new_autopilot
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.recovery.folded_rotors import allocate_folded, available_thrust, observe_folds
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, thrust_map_of
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_dynamics.vehicle import VehicleParams

VEHICLE = VehicleParams()
MAPS = rotor_maps(thrust_map_of(PropellerChoice()), VEHICLE)
ARM = VEHICLE.arm_length * math.sqrt(0.5)
HUBS = ARM * np.array([[1, -1], [-1, 1], [1, 1], [-1, -1]])
SPIN = np.array([1, 1, -1, -1])
WEIGHT = VEHICLE.mass * 9.80665
shares = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4)
sizes = st.floats(-1.5, 1.5)


def autopilot(share):
    level = np.array([0.0, 0.0, 0.0, 1.0])
    made = new_autopilot(ControlParams(), EstimatorParams(), VEHICLE, np.zeros(3), level)
    made.recovery.share = share
    return made


def allocate(share, thrust, torque):
    """Return thrust (4) that straight rotors would give, and that these give."""
    a = autopilot(share)
    a.setpoint.thrust, a.setpoint.torque = thrust, torque
    allocate_folded(a.setpoint, a.loops, a.recovery, a.nominal, MAPS)
    full = np.array(a.setpoint.rotor_thrust)
    return full, full * share


def wrench(real):
    """Collective thrust, roll and pitch torque of rotors at the hubs."""
    return real.sum(), HUBS[:, 1] @ real, -HUBS[:, 0] @ real


@given(shares, st.floats(0.0, 30.0), sizes, sizes, sizes)
def test_no_rotor_is_asked_for_more_than_it_has(share, thrust, roll, pitch, yaw):
    full, _ = allocate(np.array(share), thrust, [roll, pitch, 0.1 * yaw])
    assert (full >= MAPS.thrust_lowest - 1e-12).all()
    assert (full <= MAPS.thrust_highest + 1e-12).all()


@given(sizes, sizes)
def test_with_straight_rotors_everything_is_given(roll, pitch):
    torque = [0.3 * roll, 0.3 * pitch, 0.01]
    _, real = allocate(np.ones(4), WEIGHT, torque)
    assert wrench(real) == pytest.approx((WEIGHT, *torque[:2]), abs=1e-9)
    drag = -SPIN @ real * MAPS.torque_ratio
    assert drag == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize("folded", range(4))
def test_one_folded_rotor_leaves_weight_and_one_sense_of_tilt(folded):
    """The rotor across can push; the other two carry the weight: 2.12 of weight by 2 of 4."""
    share = np.ones(4)
    share[folded] = 0.06
    away = HUBS[folded] / np.linalg.norm(HUBS[folded])  # turns so that the folded rotor sinks
    sinks = 0.25 * np.array([-away[1], away[0], 0.0])
    _, real = allocate(share, WEIGHT, sinks)
    thrust, roll, pitch = wrench(real)
    assert thrust == pytest.approx(WEIGHT, rel=1e-6)
    assert (roll, pitch) == pytest.approx(sinks[:2], abs=1e-6)


def test_tilt_comes_before_thrust_and_thrust_before_yaw():
    share = np.array([1.0, 1.0, 0.3, 1.0])
    _, real = allocate(share, 30.0, [0.2, 0.1, 0.5])
    thrust, roll, pitch = wrench(real)
    assert (roll, pitch) == pytest.approx((0.2, 0.1), abs=1e-9)
    _, without_yaw = allocate(share, 30.0, [0.2, 0.1, 0.0])
    assert thrust == pytest.approx(without_yaw.sum(), abs=1e-9)


def test_a_fold_straightens_as_the_propeller_does_and_thrust_returns_with_its_cube():
    a = autopilot(np.ones(4))
    a.recovery.recovery_time = 0.42
    a.recovery.fold[2] = 1.0
    for _ in range(420):
        observe_folds(a.recovery, 1)
    assert a.recovery.share[2] == pytest.approx(0.9, abs=0.01)
    assert list(a.recovery.share)[:2] == [1.0, 1.0]
    assert available_thrust(a.recovery, MAPS) == pytest.approx(3.9 * MAPS.thrust_highest, rel=0.01)
