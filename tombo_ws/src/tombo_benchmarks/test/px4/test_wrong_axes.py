"""Wrong axes of a motion capture: named by a motion by hand, and never flown away with."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_benchmarks.px4.wrong_axes import FARTHEST_M, HIGHEST_M, WRONG_AXES, fly_wrong_axes
from tombo_dynamics.rotation import quaternion_multiply, rotate_vector
from tombo_flight.scenario import load_scenario, world_of
from tombo_px4.bridge.axes_proof import judge_hand_motion
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import Checklist
from tombo_px4.hil.hand_motion import HandMotion
from tombo_px4.link.messages import VehicleImu
from tombo_sim.simulator import Simulator

EPOCH_NS = 10**18
TICK_NS = 1_000_000


@pytest.fixture(scope="module")
def by_hand():
    """Poses, and what gyro and accelerometer say, of a vehicle that a hand moves."""
    simulator = Simulator(world_of(load_scenario("hover", [])), 0)
    hand, poses, imu = HandMotion(0.5), [], []
    while simulator.tick < 13_500:
        simulator.advance(np.zeros(4))
        hand(simulator)
        for sample in simulator.arrived:
            pose = sample.pose
            poses.append((EPOCH_NS + sample.stamp_ns, pose[:3].copy(), pose[3:].copy()))
        if simulator.tick % 10 == 0:
            imu.append((EPOCH_NS + simulator.tick * TICK_NS, simulator.imu.copy()))
    return poses, imu


def judge(by_hand, make):
    poses, imu = by_hand
    checklist = Checklist(BridgeParams())
    for stamp, place, attitude in poses:
        checklist.poses.add(stamp, stamp, *make(place, attitude))
    for stamp, sample in imu:
        checklist.take_imu(VehicleImu(stamp, stamp, stamp, sample[:3], sample[3:]), None, False)
    return judge_hand_motion(checklist.poses.since(0), checklist.imu.since(0), 0.17)


@pytest.mark.slow
def test_right_axes_are_proven(by_hand):
    verdict = judge(by_hand, lambda place, q: (place, q))
    assert verdict.mistake == "" and verdict.proven
    assert abs(verdict.delay_s) < 0.02


@pytest.mark.slow
def test_a_world_with_another_heading_is_proven_too(by_hand):
    turn = np.array([0.0, 0.0, np.sin(0.6), np.cos(0.6)])
    verdict = judge(
        by_hand, lambda place, q: (rotate_vector(turn, place), quaternion_multiply(turn, q))
    )
    assert verdict.proven


@pytest.mark.slow
def test_without_being_carried_there_is_no_proof(by_hand):
    verdict = judge(by_hand, lambda place, q: (0.0 * place, q))
    assert verdict.mistake == "" and not verdict.proven


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG_AXES)
def test_every_wrong_set_up_is_named_by_a_motion_by_hand(by_hand, name):
    wrong = WRONG_AXES[name]
    verdict = judge(by_hand, wrong.make)
    assert wrong.word in verdict.mistake and not verdict.proven
    # no rotation of axes explains these: one message has both
    assert verdict.sure == (wrong.word not in ("w first", "inverse"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["body yawed by 90 deg", "body yawed by 180 deg", "body on the floor"]
)
def test_with_the_proof_of_another_body_it_lands_near_where_it_took_off(tmp_path, name):
    row = fly_wrong_axes(Px4Setup(None, tmp_path / "px4"), f"{name}, old proof")
    assert row["armed"] and row["disarmed"]
    assert row["away_m"] <= FARTHEST_M and row["height_m"] <= HIGHEST_M and row["text"]


@pytest.mark.slow
def test_the_simulated_px4_flies_away_with_wrong_axes_where_nobody_watches(tmp_path, monkeypatch):
    """As a real one does: else the flights above would show nothing."""
    monkeypatch.setattr(Checklist, "motion_findings", lambda *args: [])
    row = fly_wrong_axes(Px4Setup(None, tmp_path / "px4"), "body yawed by 180 deg, old proof")
    assert row["armed"] and row["away_m"] > 2.0 and not row["landed"]
