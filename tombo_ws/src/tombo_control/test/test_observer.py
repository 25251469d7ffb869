"""The estimator as a node sees it: bad, late and lost samples, a beginning in flight."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core_calls import Estimator
from lockstep_bench import EPOCH_NS, Lockstep, calm, hover_at, hovering
from tombo_control.params import EstimatorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import TICK_NS
from tombo_dynamics.vehicle import GRAVITY, VehicleParams

_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_MOCAP_TICKS = 33


class _Ride:
    """An observer on a vehicle that moves evenly, level, without noise; poses come 10 ms late."""

    def __init__(self, velocity: Any = (0.0, 0.0, 0.0), begin_s: float = 0.0) -> None:
        self.observer = Estimator(EstimatorParams(), VehicleParams())
        self.observer.phase(Phase.HOVER)
        self.velocity = np.array(velocity)
        self.tick = round(begin_s * 1000)
        self.answers: list[PoseRefusal] = []
        self.late = 10

    def place(self, tick: int) -> Array:
        return np.array([0.0, 0.0, 2.0]) + tick * 1e-3 * self.velocity

    def ns(self, tick: int) -> int:
        return EPOCH_NS + tick * TICK_NS

    def pose(self, **wrong: Any) -> PoseRefusal:
        """Hand over the pose captured `late` ticks ago, with something wrong about it."""
        captured = self.tick - self.late
        values: dict[str, Any] = {
            "stamp_ns": self.ns(captured),
            "now_ns": self.ns(self.tick),
            "frame_id": "map",
            "position": self.place(captured),
            "attitude": _LEVEL,
        }
        return self.observer.pose(**{**values, **wrong})

    def imu(self) -> None:
        force = np.array([0.0, 0.0, GRAVITY])
        self.observer.imu(self.ns(self.tick), np.zeros(3), force)

    def run(self, ticks: int, imu: bool = True, poses: bool = True) -> None:
        for _ in range(ticks):
            if poses and self.tick % _MOCAP_TICKS == self.late:
                self.answers.append(self.pose())
            if imu:
                self.imu()
            self.tick += 1

    @property
    def error(self) -> float:
        """Of the newest estimate's position [m]."""
        estimate = self.observer.estimate
        tick = (estimate.stamp_ns - EPOCH_NS) // TICK_NS
        return float(np.linalg.norm(estimate.position - self.place(tick)))

    @property
    def age_ticks(self) -> int:
        estimate = self.observer.estimate
        return self.tick - 1 - (estimate.stamp_ns - EPOCH_NS) // TICK_NS


@pytest.fixture
def ride() -> _Ride:
    started = _Ride((1.0, 0.0, 0.0))
    started.run(600)
    assert started.error < 1e-6
    return started


def _estimate_error(flight: Lockstep) -> float:
    estimate = flight.observer.estimate
    before = flight.position - 1e-3 * flight.velocity  # the estimate is of the tick before
    return float(np.linalg.norm(estimate.position - before))


# --- beginning


def test_the_third_pose_begins_an_estimate_with_place_and_velocity() -> None:
    ride = _Ride((0.6, -0.8, 0.0))
    ride.run(_MOCAP_TICKS + ride.late + 1)
    assert len(ride.answers) == 2
    assert ride.observer.estimate is None
    ride.run(_MOCAP_TICKS + 1)
    assert ride.error < 1e-6
    assert np.allclose(ride.observer.estimate.velocity, ride.velocity)
    assert ride.observer.estimate.pose_stamp_ns == ride.ns(2 * _MOCAP_TICKS)


@pytest.mark.parametrize("bodies", [2, 3])
def test_bodies_that_take_turns_in_one_topic_do_not_begin_an_estimate(bodies: int) -> None:
    ride = _Ride()
    for k in range(20):
        ride.run(30, poses=False)
        place = np.array([1.5 * (k % bodies), 0.0, 2.0])
        assert ride.pose(position=place) == (PoseRefusal.JUMP if k else PoseRefusal.NONE)
    assert ride.observer.estimate is None


@pytest.mark.slow
def test_restarted_in_flight_it_converges_within_a_second() -> None:
    flight = hovering(calm("effects.mocap_noise.position=0.0007"))
    begin = flight.simulator.tick * 1e-3
    flight.steer = lambda t: hover_at(t - begin, 0.0, 2.0, (1.0, 0.0, 0.0))
    flight.fly(3.0)
    assert abs(flight.velocity[0] - 1.0) < 0.1
    flight.observer = Estimator(flight.scenario.estimator, flight.scenario.vehicle)
    flight.observer.phase(Phase.HOVER)
    flight.fly(0.15)
    assert flight.observer.estimate is not None
    flight.fly(0.85)
    assert _estimate_error(flight) < 0.015
    estimate = flight.observer.estimate
    assert np.linalg.norm(estimate.velocity - flight.velocity) < 0.08
    assert abs(flight.position[2] - 2.0) < 0.15


# --- refused poses


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"frame_id": "world"}, PoseRefusal.WRONG_FRAME),
        ({"position": np.array([np.nan, 0.0, 2.0])}, PoseRefusal.NOT_FINITE),
        ({"attitude": np.array([0.0, 0.0, 0.0, 1.2])}, PoseRefusal.NOT_UNIT),
        ({"stamp_ns": EPOCH_NS + 606 * TICK_NS}, PoseRefusal.FUTURE),
        ({"stamp_ns": EPOCH_NS + 500 * TICK_NS}, PoseRefusal.OUT_OF_ORDER),
        ({"stamp_ns": 0}, PoseRefusal.LATE),
        ({"position": np.array([1.5, 0.0, 2.0])}, PoseRefusal.JUMP),
    ],
)
def test_a_bad_pose_is_refused_by_name_and_the_estimate_goes_on(
    ride: _Ride, wrong: dict[str, Any], why: str
) -> None:
    used, refused = ride.observer.memory.poses, ride.observer.memory.rejected
    assert ride.pose(**wrong) == why
    assert ride.observer.memory.rejected == refused + 1
    ride.answers.clear()
    ride.run(200)
    assert set(ride.answers) == {PoseRefusal.NONE}
    assert ride.observer.memory.poses == used + len(ride.answers)
    assert ride.error < 1e-6
    assert ride.age_ticks == 0


def test_a_pose_that_comes_before_the_imu_of_its_time_waits_for_it(ride: _Ride) -> None:
    used = ride.observer.memory.poses
    ride.late = -2  # stamped 2 ms ahead of the last IMU sample, within what two clocks may differ
    ahead = ride.ns(ride.tick + 2)
    assert ride.pose() == PoseRefusal.NONE
    ride.run(2, poses=False)
    assert ride.observer.memory.poses == used
    ride.run(1, poses=False)
    assert ride.observer.memory.poses == used + 1
    assert ride.observer.memory.rejected == 0
    estimate = ride.observer.estimate
    assert estimate.pose_stamp_ns == ahead
    assert ride.error < 1e-6


# --- jumps


def test_a_jump_that_persists_begins_the_estimate_again(ride: _Ride) -> None:
    ride.place = lambda tick: np.array([tick * 1e-3, 4.0, 2.0])
    ride.answers.clear()
    ride.run(12 * _MOCAP_TICKS)
    assert ride.answers[:5] == 5 * [PoseRefusal.JUMP]
    assert set(ride.answers[5:]) == {PoseRefusal.NONE}
    assert ride.error < 1e-6


# --- IMU


@pytest.mark.parametrize("gap", [5, 50])
def test_a_gap_of_the_imu_is_bridged(ride: _Ride, gap: int) -> None:
    ride.run(gap, imu=False)
    ride.run(1)
    assert ride.observer.memory.lost_samples == gap
    assert ride.error < 1e-3
    assert ride.age_ticks == 0


def test_after_200_ms_without_imu_the_estimate_begins_again(ride: _Ride) -> None:
    ride.run(200, imu=False)
    ride.run(1)
    assert ride.observer.estimate is None
    ride.run(4 * _MOCAP_TICKS)
    assert ride.error < 1e-6


def test_a_sample_twice_or_out_of_order_is_left_out(ride: _Ride) -> None:
    before = ride.observer.estimate
    force = np.array([0.0, 0.0, 100.0])
    assert ride.observer.imu(ride.ns(599), np.ones(3), force) is None
    assert ride.observer.imu(ride.ns(590), np.ones(3), force) is None
    assert ride.observer.estimate.stamp_ns == before.stamp_ns
    ride.run(100)
    assert ride.error < 1e-6


def test_an_imu_sample_that_is_not_finite_is_bridged(ride: _Ride) -> None:
    ride.observer.imu(ride.ns(600), np.full(3, np.nan), np.full(3, np.inf))
    estimate = ride.observer.estimate
    values = [estimate.position, estimate.velocity, estimate.attitude, estimate.rates]
    assert np.isfinite(np.concatenate(values)).all()
    ride.tick += 1
    ride.run(300)
    assert ride.error < 1e-3


def test_stamps_with_jitter_lose_no_state() -> None:
    chance = np.random.default_rng(0)
    ride = _Ride((1.0, 0.0, 0.0))
    ride.ns = lambda tick: EPOCH_NS + int((tick + chance.uniform(-0.4, 0.4)) * TICK_NS)
    ride.run(2000)
    assert ride.observer.memory.lost_samples == 0
    assert ride.error < 2e-3


# --- clocks


@pytest.mark.parametrize("by_s", [-3600.0, 3600.0])
def test_a_clock_that_is_set_begins_a_new_estimate(by_s: float) -> None:
    ride = _Ride((1.0, 0.0, 0.0), begin_s=4000.0)
    ride.run(600)
    place, tick = ride.place, ride.tick
    ride.tick += round(by_s * 1000)
    there = place(tick) - place(ride.tick)
    ride.place = lambda tick: place(tick) + there
    ride.run(6 * _MOCAP_TICKS)
    assert ride.error < 1e-6
    assert ride.age_ticks == 0


# --- phase and parameters


def test_on_the_ground_the_velocity_is_zero() -> None:
    ride = _Ride()
    ride.observer.phase(Phase.IDLE)
    ride.run(200)
    for _ in range(300):
        ride.observer.imu(ride.ns(ride.tick), np.zeros(3), np.array([3.0, 0.0, GRAVITY]))
        ride.tick += 1
    estimate = ride.observer.estimate
    assert not estimate.velocity.any()
    assert ride.error < 1e-6
