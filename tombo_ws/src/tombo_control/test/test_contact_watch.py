"""The contact trigger: the rotor of a push, and pushes that are not contacts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tombo_control.autopilot import EstimatedState
from tombo_control.recovery.contact_watch import ContactWatch, watch_contact
from tombo_control.recovery.params import ContactParams
from tombo_dynamics.records import fill_record, parameter_record
from tombo_dynamics.vehicle import VehicleParams

VEHICLE = VehicleParams()
MILLISECOND = 1e-3
PEAK, FADES = 145.0, 0.014
"""N, s: a strike of the paper's propeller."""
HUBS = VEHICLE.arm_length * math.sqrt(0.5) * np.array([[1, -1], [-1, 1], [1, 1], [-1, -1]])


def watch(gyro, accel, height=2.0, params=None, flies=True):
    """Feed samples (N, 3) each; return the contact and the samples at which one was due."""
    contact, state = ContactWatch.new(), EstimatedState.new()
    fill_record(contact.params, params or ContactParams())
    state.position[2] = height
    state.attitude[3] = 1.0
    contact.tick = -1000
    nominal, due = parameter_record(VEHICLE), []
    for k, (w, a) in enumerate(zip(gyro, accel, strict=True)):
        watch_contact(contact, state, nominal, w, a, k, flies)
        if contact.due:
            due.append(k)
    return contact, due


def strike(rotor, bearing, slant=0.0, begin=50, length=120):
    """Return gyro and accelerometer of a rigid body that is pushed at a hub.

    Args:
        rotor: that is struck.
        bearing: direction from its hub to the obstacle, about the arm's own [rad].
        slant: of the push from there [rad].
        begin: first sample of the push.
        length: samples.
    """
    hub = HUBS[rotor]
    to_obstacle = math.atan2(hub[1], hub[0]) + bearing
    away = to_obstacle + math.pi + slant
    gyro, accel = np.zeros((length, 3)), np.tile([0.0, 0.0, 9.8], (length, 1))
    turned = 0.0
    for k in range(begin, length):
        force = max(PEAK * (1.0 - (k - begin) * MILLISECOND / FADES), 0.0)
        push = force * np.array([math.cos(away), math.sin(away)])
        accel[k, :2] = push / VEHICLE.mass
        moment = hub[0] * push[1] - hub[1] * push[0]
        turned += moment / VEHICLE.inertia_zz * MILLISECOND
        gyro[k, 2] = turned
    return gyro, accel


@pytest.mark.parametrize("rotor", range(4))
@pytest.mark.parametrize("bearing", [-0.8, -0.3, 0.0, 0.4, 0.8])
@pytest.mark.parametrize("slant", [-0.4, 0.0, 0.4])
def test_the_struck_rotor_is_named_within_five_milliseconds(rotor, bearing, slant):
    rng = np.random.default_rng(rotor)
    gyro, accel = strike(rotor, bearing, slant)
    noisy = accel + rng.normal(0.0, 1.0, accel.shape)
    contact, due = watch(gyro + rng.normal(0.0, 0.02, gyro.shape), noisy)
    assert due and due[0] - 50 <= 4 and len(due) == 1
    assert contact.rotor == rotor


def test_the_push_is_told_in_map_and_of_unit_length():
    contact, _ = watch(*strike(2, 0.0))
    assert np.linalg.norm(contact.direction) == pytest.approx(1.0)
    assert contact.direction[:2] == pytest.approx([-math.sqrt(0.5)] * 2, abs=1e-6)


def test_vibration_and_flight_are_no_contact():
    t = np.arange(5000) * MILLISECOND
    accel = np.zeros((t.size, 3))
    for k, speed in enumerate((500.0, 511.0, 520.0, 530.0)):  # four rotors, 4.2 m/s^2 RMS in all
        size = 4.2 / math.sqrt(2.0) * (1.0 + 1.0 * (t > 2.0))  # full thrust after 2 s
        accel[:, 0] += size * np.cos(speed * t + k)
        accel[:, 1] += size * np.sin(speed * t + k)
    contact, due = watch(np.zeros_like(accel), accel)
    assert not due
    assert math.sqrt(contact.mean_square) > 5.0  # it has seen it


@pytest.mark.parametrize(
    ("name", "options"), [("low", {"height": 0.5}), ("on the ground", {"flies": False})]
)
def test_it_is_armed_in_the_air_and_above_a_height(name, options):
    assert not watch(*strike(0, 0.0), **options)[1]


def test_one_bad_sample_is_no_contact_and_nan_is_none():
    gyro, accel = np.zeros((200, 3)), np.zeros((200, 3))
    accel[50, 0] = 300.0
    accel[100] = math.nan
    gyro[120] = math.inf
    assert not watch(gyro, accel)[1]


def test_a_second_strike_is_known_after_the_holdoff():
    first, second = strike(2, 0.0, length=220), strike(0, 0.0, begin=150, length=220)
    contact, due = watch(first[0] + second[0], first[1] + second[1])
    assert len(due) == 2 and contact.count == 2 and contact.rotor == 0
