"""Poses must move as PX4's sensors say; else the vehicle lands by thrust."""

import math
import re

import numpy as np
import pytest

from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import Checklist
from tombo_px4.bridge.flight_watch import FlightWatch, RepeatedPose
from tombo_px4.bridge.pose_motion import sum_motion
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.link.messages import VehicleImu, VehicleOdometry

MS = 1_000_000
GRAVITY = 9.80665
NOW = 1_763_700_000_000_000_000
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def yaw_matrix(degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def still(place):
    return np.array([0.01, -0.01, 0.18])


def stuck(height):
    """Return the poses of a body that stops moving at a height of the vehicle."""
    kept = []

    def shown(place):
        if not kept and place[2] > height:
            kept.append(place.copy())
        return kept[0] if kept else place

    return shown


class Flight:
    """A point mass takes off; a loop tilts it against the distance that the poses show."""

    def __init__(
        self, as_mocap, lean=0.05, rate_hz=50, noise_m=0.0007, closed=True, wobble=0.0,
        leans_s=0.0, tilt_error_m_s2=0.0, takes_off=False,
    ):  # fmt: skip
        self.as_mocap = as_mocap if callable(as_mocap) else lambda place: as_mocap @ place
        self.lean, self.rate_hz, self.noise, self.closed = lean, rate_hz, noise_m, closed
        self.wobble = wobble
        self.leans_s, self.tilt_error, self.takes_off = leans_s, tilt_error_m_s2, takes_off
        self.rng = np.random.default_rng(4)
        params = BridgeParams()
        self.checklist = Checklist(params)
        self.watch = FlightWatch(params, FlightLimits(), self.checklist)
        self.mistake = None
        self.place, self.speed = np.array([0.01, -0.01, 0.18]), np.zeros(3)
        self.farthest = self.highest = 0.0
        self.shown = self.as_mocap(self.place)

    def run(self, seconds=3.0, lifts_off=True, goal_m=2.0):
        for k in range(-1000, round(seconds * 1000)):
            shown = self.as_mocap(self.place)
            rate, self.shown = (shown - self.shown) * 1e3, shown
            push, rates = np.zeros(3), np.zeros(3)
            if k > 300 and lifts_off:
                if self.closed:
                    push[:2] = np.clip(-shown[:2] - 1.5 * rate[:2], -2.0, 2.0)
                lean = self.lean * GRAVITY * (k > 1000 * self.leans_s)
                push[0] += lean * math.sin(4.0 * k * 1e-3)
                push[1] += lean * math.cos(3.0 * k * 1e-3)
                push[2] = np.clip(2.0 * (goal_m - shown[2]) - 3.0 * rate[2], -2.0, 2.0)
                rates[0] = self.wobble * math.sin(6.0 * k * 1e-3)
            self.speed, self.place = self.speed + push * 1e-3, self.place + self.speed * 1e-3
            self.highest = max(self.highest, float(self.place[2]))
            self.farthest = max(self.farthest, float(np.linalg.norm(self.place[:2])))
            self._send(k, push, rates, airborne=k > 300)
            beside = float(np.linalg.norm(shown[:2])) * self.takes_off
            self.mistake = self.watch.follow(NOW + k * MS, k >= 0, self.takes_off, beside)
            if self.mistake:
                break
        return self

    @property
    def confirmed(self):
        return self.checklist.motion.confirmed

    @property
    def velocity(self):
        return self.checklist.motion.velocity

    def _send(self, k, push, rates, airborne):
        if k % 10 == 0:
            force = push + np.array([0.0, 0.0, GRAVITY]) + self.rng.normal(0.0, 0.1, 3)
            force[0] += self.tilt_error * airborne
            now = NOW + k * MS
            estimate = VehicleOdometry(now, now, now, self.shown, LEVEL, np.zeros(3), rates, None)
            self.checklist.take_imu(VehicleImu(now, now, now, rates, force), estimate, airborne)
        if k % (1000 // self.rate_hz) == 0:
            shown = self.shown + self.rng.normal(0.0, self.noise, 3)
            self.watch.pose_ns = NOW + k * MS
            self.checklist.poses.add(NOW + k * MS, NOW + k * MS, shown, LEVEL)


@pytest.mark.parametrize("rate_hz", [30, 50, 100])
@pytest.mark.parametrize("degrees", [0.0, 8.0, -8.0])
def test_right_axes_are_confirmed(degrees, rate_hz):
    flight = Flight(yaw_matrix(degrees), rate_hz=rate_hz).run(8.0)
    assert flight.mistake is None and flight.confirmed


@pytest.mark.parametrize("degrees", [60, 90, -90, 135, 180])
def test_a_turned_body_is_named_within_the_first_metre(degrees):
    flight = Flight(yaw_matrix(degrees)).run()
    assert "is not the nose" in flight.mistake.text
    named_degrees = int(re.search(r"move ([+-]\d+) deg", flight.mistake.text)[1])
    assert abs((named_degrees - degrees + 180) % 360 - 180) < 25
    assert flight.farthest < 0.3 and flight.highest < 1.2


def test_heights_that_are_upside_down_are_named_while_it_climbs():
    flight = Flight(np.diag([1.0, 1.0, -1.0])).run()
    assert flight.mistake and flight.highest < 0.6


@pytest.mark.parametrize("rate_hz", [30, 100])
def test_a_body_that_does_not_move_is_named_before_the_vehicle_is_half_a_metre_high(rate_hz):
    flight = Flight(still, rate_hz=rate_hz).run(6.0)
    assert "does not move" in flight.mistake.text and flight.highest < 0.68


def test_a_body_that_stays_behind_in_flight_is_named_soon():
    flight = Flight(stuck(0.8)).run(10.0)
    assert flight.mistake and flight.highest < 1.3


@pytest.mark.parametrize("scale", [0.6, 1.5])
def test_positions_of_another_scale_are_named(scale):
    flight = Flight(lambda place: scale * place).run()
    assert "times as far" in flight.mistake.text and flight.highest < 1.0


def test_a_vehicle_that_stands_with_rotors_on_is_not_judged():
    flight = Flight(still).run(6.0, lifts_off=False)
    assert flight.mistake is None and not flight.confirmed


def test_the_velocity_of_the_accelerometer_is_that_of_the_vehicle():
    flight = Flight(still).run(6.0)
    assert np.linalg.norm(flight.velocity - flight.speed) < 0.15


def test_a_body_that_stays_behind_leaves_the_velocity_of_the_vehicle():
    flight = Flight(stuck(0.8)).run(10.0)
    assert flight.mistake
    assert np.linalg.norm(flight.velocity - flight.speed) < 0.12


@pytest.mark.parametrize("axes", [yaw_matrix(110), yaw_matrix(180), np.diag([1.0, -1.0, 1.0])])
def test_wrong_axes_leave_the_velocity_to_brake_by(axes):
    flight = Flight(axes, lean=0.002, tilt_error_m_s2=0.08, takes_off=True).run(20.0)
    assert flight.mistake
    speed = np.linalg.norm(flight.speed[:2])
    assert speed > 0.05
    assert np.linalg.norm((flight.velocity - flight.speed)[:2]) < 0.6 * speed


def test_poses_that_repeat_count_only_while_the_vehicle_moves():
    repeated, place = RepeatedPose(), np.array([1.0, 2.0, 0.2])
    assert not any(repeated.repeats(k * 10 * MS, place, LEVEL) for k in range(300))
    repeated.moves()
    assert repeated.repeats(3001 * MS, place, LEVEL)
    assert not repeated.repeats(3010 * MS, place + 1e-6, LEVEL)


def test_noise_of_the_poses_widens_the_slope_and_does_not_move_it():
    rng = np.random.default_rng(0)
    felt = rng.normal(0.0, 0.1, (400, 3))
    shaken = felt + rng.normal(0.0, 0.2, (400, 3))
    quiet, noisy = (sum_motion(seen, felt, np.full(400, 0.02)) for seen in (felt, shaken))
    assert quiet.slope == pytest.approx(1.0) and quiet.error < 0.01
    assert abs(noisy.slope - 1.0) < noisy.error and noisy.error > 0.2
