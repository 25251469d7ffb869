"""Each fault of a laboratory is named with cause and cure; a good set-up passes."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from bridge_flight import MS, NOW, synced
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.rotation import quaternion_multiply, rotate_vector
from tombo_px4.autopilot.parameters import FLOWN_BY_POSES
from tombo_px4.autopilot.parameters import PARAMETERS as PX4_PARAMETERS
from tombo_px4.bridge.axes_proof import AxesEvidence, HandVerdict
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.bridge.checklist import Checklist
from tombo_px4.bridge.vehicle_parameters import SAFE_PARAMETERS, parse_assignments
from tombo_px4.link.messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.timesync import TimeSync

SECOND = 1000 * MS
VERDICT = HandVerdict((1.5, 1.2, 2.0), (1.4, 1.2, 1.1), 1.1, 0.01, moves=True)
PARAMETERS = {p.name: p.default for p in PX4_PARAMETERS} | FLOWN_BY_POSES
"""Of a vehicle that flies by poses alone."""


def spin(axis, angle):
    """xyzw of a turn about x, y or z."""
    q = np.zeros(4)
    q["xyz".index(axis)], q[3] = math.sin(angle / 2), math.cos(angle / 2)
    return q


class Lab:
    """A vehicle that stands there for two seconds, seen by mocap and by PX4."""

    def __init__(self, **params):
        self.params = BridgeParams(**{"axes_evidence": SIMULATED, **params})
        self.place = np.array([1.0, 2.0, 0.18])
        self.attitude = spin("z", 0.5)
        self.as_mocap = lambda place, attitude: (place, attitude)
        self.as_px4 = lambda place, attitude: (place, attitude)
        self.latency = 0.02
        self.rate = 50
        self.noise = 0.0003
        self.shake = 0.02
        self.values = dict(PARAMETERS)
        self.sync = synced()
        self.answered = 20
        self.estimator = EstimatorStatusFlags(NOW, True, True, 0.2, 0.1)
        self.telemetry = True
        self.flying = False
        self.last_pose_s = 0.0
        self.gyro = np.zeros(3)

    def preflight(self):
        rng = np.random.default_rng(1)
        made = Checklist(self.params)
        for k in range(2 * self.rate):
            arrival = NOW - 2 * SECOND + (k + 1) * SECOND // self.rate
            if arrival > NOW - self.last_pose_s * SECOND:
                break
            place, attitude = self.as_mocap(self.place, self.attitude)
            place = place + rng.normal(0, self.noise, 3) if self.noise else place
            made.poses.add(arrival - round(self.latency * 1e9), arrival, place, attitude)
        back = self.attitude * [-1, -1, -1, 1]
        up = rotate_vector(back, np.array([0.0, 0.0, 9.81]))
        for k in range(200 if self.telemetry else 0):
            arrival = NOW - 2 * SECOND + (k + 1) * 10 * MS
            stamp = arrival - 2 * MS
            gyro = self.gyro + rng.normal(0, 0.1 * self.shake, 3)
            accel = up + rng.normal(0, self.shake, 3)
            made.take_imu(VehicleImu(arrival, stamp, 1, gyro, accel), None, self.flying)
            place, attitude = self.as_px4(self.place, self.attitude)
            zero = np.zeros(3)
            estimate = VehicleOdometry(arrival, stamp, 1, place, attitude, zero, zero, None)
            made.take_odometry(estimate)
        made.estimator = self.estimator
        return made

    def findings(self, made=None):
        return (made or self.preflight()).findings(
            NOW,
            self.sync,
            self.values,
            linked_ns=NOW - 10 * SECOND,
            answered=self.answered,
            flying=self.flying,
        )

    def text(self, key, blocks=True):
        """The text of a finding that forbids to arm."""
        findings = {f.check.key: f for f in self.findings()}
        assert key in findings, sorted(findings)
        assert findings[key].check.blocks == blocks
        return findings[key].text

    def warning(self, key):
        return self.text(key, blocks=False)

    def finding_keys(self):
        return {f.check.key for f in self.findings()}


@pytest.fixture
def lab():
    return Lab()


@settings(max_examples=25)
@given(
    st.floats(-3.1, 3.1),
    st.floats(-0.05, 0.05),
    st.floats(-5, 5),
    st.sampled_from([30, 50, 100, 250]),
    st.floats(0.0, 0.1),
)
def test_a_good_set_up_passes(yaw, tilt, x, rate, latency):
    lab = Lab()
    lab.attitude = quaternion_multiply(spin("z", yaw), spin("x", tilt))
    lab.place = np.array([x, -x, 0.18])
    lab.rate, lab.latency = rate, latency
    assert lab.findings() == []


# --- stamps and silence ------------------------------------------------------------------------


def follows(*place):
    """PX4's position is there, whatever the poses say."""
    return {"as_px4": lambda p, q: (np.array(place), q)}


def both(mangle):
    """Poses and PX4's estimate, which follows them, come otherwise than the vehicle is."""
    return {"as_mocap": mangle, "as_px4": mangle}


def two_bodies():
    turns = itertools.cycle([0.0, 1.5])
    return {"as_mocap": lambda p, q: (p + np.array([next(turns), 0.0, 0.0]), q)}


def rotated(axis, angle):
    return lambda place, q: (place, quaternion_multiply(q, spin(axis, angle)))


def estimator(**fields):
    """What PX4 says of its estimator."""
    values = {"has_position": True, "is_aided": True, "position_ratio": 0.2, "height_ratio": 0.1}
    return {"estimator": EstimatorStatusFlags(NOW, **(values | fields))}


def parameters(**values):
    return {"values": PARAMETERS | {"SYS_HAS_GPS": 1} | values}


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        ({"rate": 0}, "pose_stale", "is the driver running"),
        ({"last_pose_s": 0.7}, "pose_stale", "no mocap pose has come for 0.7 s"),
        ({"sync": TimeSync()}, "timesync", "TIMESYNC has not converged"),
        ({"telemetry": False}, "no_position", "sends no position"),
        ({"telemetry": False}, "no_imu", "HIGHRES_IMU"),
        (
            estimator(has_position=False, is_aided=False),
            "not_fused",
            "knows no position though poses are sent",
        ),
        (estimator(position_ratio=3.2), "poses_refused", "test ratio 3.2"),
        (estimator(position_ratio=math.nan, height_ratio=4.1), "poses_refused", "test ratio 4.1"),
        (parameters(EKF2_EV_CTRL=0), "not_fused", "position is not fused: EKF2_EV_CTRL is 0"),
        (parameters(EKF2_EV_CTRL=8), "not_fused", "position is not fused: EKF2_EV_CTRL is 8"),
        (both(lambda p, q: (p, np.roll(q, 1))), "mocap_up", "quaternion is w first"),
        (both(rotated("x", math.pi)), "mocap_up", "tilted by 180 deg"),
        ({"as_mocap": rotated("y", 0.35)}, "mocap_up", "tilted by 20 deg"),
        (follows(1.25, 2.0, 0.18), "position_differs", "0.25 m away"),
        ({"noise": 0.05}, "pose_moves", "another body is tracked"),
        (both(lambda p, q: (1e3 * p, q)) | {"noise": 0.3}, "pose_moves", "in millimetres"),
        (two_bodies(), "pose_bodies", "take turns in one topic, 1.50 m apart"),
    ],
)
def test_a_fault_that_forbids_to_arm_is_named(lab, change, key, words):
    vars(lab).update(change)
    assert words in lab.text(key)


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        ({"rate": 10}, "pose_rate", "come at 10 Hz"),
        ({"answered": 0}, "timesync_unasked", "arrival of poses for"),
        (parameters(EKF2_EV_CTRL=3), "mocap_parameters", "without bit 3 no yaw"),
        (parameters(EKF2_EV_CTRL=9), "mocap_parameters", "without bit 1 no height"),
        (parameters(EKF2_HGT_REF=0), "mocap_parameters", "0 the barometer"),
        (parameters(EKF2_GPS_CTRL=7), "mocap_parameters", "EKF2_GPS_CTRL is 7, set it to 0"),
        (parameters(EKF2_RNG_CTRL=1), "mocap_parameters", "range finder"),
        (parameters(EKF2_MAG_TYPE=0), "mocap_parameters", "magnetometer"),
        (parameters(EKF2_EV_DELAY=175.0), "mocap_parameters", "is 175, set it to 0"),
    ],
)
def test_a_fault_that_may_be_flown_with_is_a_warning(lab, change, key, words):
    vars(lab).update(change)
    assert words in lab.warning(key)


@pytest.mark.parametrize(
    "change",
    [
        {"noise": 0.0, "shake": 0.0},  # a world without any noise is not frozen
        {"flying": True, "as_px4": lambda p, q: (p + np.array([0.3, 0.0, 0.0]), q)},
        estimator(position_ratio=math.nan, height_ratio=math.nan),
        {"estimator": None},
        {"values": {}},
    ],
    ids=["no noise", "lag in flight", "no ratios", "no estimator status", "no parameters"],
)
def test_what_is_unknown_or_usual_is_no_fault(lab, change):
    vars(lab).update(change)
    assert lab.finding_keys() == set()


def test_a_frozen_pose(lab):
    lab.noise = 0.0
    assert "frozen: not one bit has changed" in lab.warning("pose_frozen")
    lab.flying = True
    assert "pose_frozen" not in lab.finding_keys(), "in flight the bridge does not send it"


@pytest.mark.parametrize("sure", [True, False])
def test_poses_that_turn_otherwise_than_the_gyro_forbid_arming(lab, sure):
    made = lab.preflight()
    made.verdict = VERDICT._replace(mistake="poses turn otherwise than PX4's gyro", sure=sure)
    (finding,) = lab.findings(made)
    assert (finding.check.key, finding.check.blocks) == ("mocap_axes", True)


def test_a_proof_counts_for_the_hardware_that_it_names():
    lab = Lab(axes_evidence="", tracked_body="s500")
    made = Checklist(lab.params, (replace(PROOF, vehicle="a1"), replace(PROOF, vehicle="b2")))
    made.take_vehicle("b2")
    assert made.evidence is not None and made.evidence.vehicle == "b2"
    made.take_vehicle("c3")
    assert made.evidence is None


@pytest.mark.parametrize(
    ("why", "age", "words"),
    [
        (PoseRefusal.FUTURE, -1.2, "stamps are 1.2 s in the future: the clock"),
        (PoseRefusal.LATE, 3.4, "stamps are 3.4 s old when they arrive"),
        (PoseRefusal.WRONG_FRAME, 0.0, "not in frame map"),
        (PoseRefusal.NOT_FINITE, 0.0, "lost the body"),
        (PoseRefusal.NOT_UNIT, 0.0, "no rotations"),
        (PoseRefusal.OUT_OF_ORDER, 0.0, "do not grow"),
        (PoseRefusal.TWO_PUBLISHERS, 0.0, "stop one of them"),
    ],
)
def test_refused_poses_are_named_for_as_long_as_they_come(lab, why, age, words):
    made = lab.preflight()
    made.refused_pose(why, NOW - 100 * MS, age)
    (finding,) = lab.findings(made)
    assert finding.check.blocks
    assert words in finding.text
    made.refused_pose(why, NOW - 3 * SECOND, age)
    assert lab.findings(made) == []


# --- axes --------------------------------------------------------------------------------------

Y_UP = spin("x", -math.pi / 2)
"""Axes with z up into axes with y up: (x, y, z) -> (x, z, -y)."""


def y_up_world_and_body(place, attitude):
    q = quaternion_multiply(quaternion_multiply(Y_UP, attitude), Y_UP * [-1, -1, -1, 1])
    return rotate_vector(Y_UP, place), q


def y_up_world(place, attitude):
    return rotate_vector(Y_UP, place), quaternion_multiply(Y_UP, attitude)


@pytest.mark.parametrize("yaw", [-2.0, 0.0, 0.5, math.pi / 2, math.pi])
def test_y_up_in_the_world_is_a_mistake_that_the_finding_names(lab, yaw):
    lab.attitude = spin("z", yaw)
    lab.as_mocap = lab.as_px4 = y_up_world
    text = lab.text("mocap_up")
    assert "pose is Y-up" in text and "Motive" in text
    assert "by hand, which tells them apart" in text


def test_y_up_in_world_and_body_shows_at_rest_only_if_the_nose_points_elsewhere(lab):
    lab.as_mocap = lab.as_px4 = y_up_world_and_body
    assert "pose is Y-up" in lab.text("mocap_up")
    lab.params = BridgeParams()
    lab.attitude = spin("z", 0.0)  # looks level: nothing but a proof by hand keeps it down
    assert lab.finding_keys() == {"axes_unproven"}


def test_up_is_not_judged_in_flight_nor_in_somebodys_hands(lab):
    lab.as_mocap = lab.as_px4 = y_up_world
    lab.flying = True
    assert "mocap_up" not in lab.finding_keys()
    lab.flying, lab.gyro = False, np.array([0.0, 0.0, 1.0])
    assert "mocap_up" not in lab.finding_keys()


@pytest.mark.parametrize("turn", [90, -90, 180, 35])
def test_a_heading_that_px4_has_from_elsewhere_is_compared(lab, turn):
    """By its magnetometer, that is; with the poses' own yaw there is nothing to compare."""
    lab.as_mocap = lambda p, q: (p, quaternion_multiply(q, spin("z", math.radians(turn))))
    assert f"differs from PX4 by {turn:+} deg" in lab.text("yaw_differs") or turn == 180


# --- the proof of the axes ---------------------------------------------------------------------


@pytest.mark.parametrize("turn", [45, 90, 180])
def test_a_body_whose_x_is_not_the_nose_is_not_armed_without_a_proof(turn):
    lab = Lab(axes_evidence="")
    lab.as_mocap = lab.as_px4 = lambda p, q: (
        p,
        quaternion_multiply(q, spin("z", math.radians(turn))),
    )
    text = lab.text("axes_unproven")
    assert "turn the vehicle by hand about each axis, 1 rad in all" in text
    assert lab.finding_keys() == {"axes_unproven"}, "at rest nothing else shows it"


PROOF = AxesEvidence("2026-11-24T10:00:00+00:00", "s500", "a1", tilt_rad=[0.0, 0.0])


def test_a_proof_of_this_body_allows_to_arm():
    lab = Lab(axes_evidence="")
    made = lab.preflight()
    made.evidence = PROOF
    assert lab.findings(made) == []


def test_a_body_that_lies_otherwise_in_the_vehicle_needs_another_proof():
    lab = Lab(axes_evidence="")
    lab.as_mocap = lambda p, q: (p, quaternion_multiply(q, spin("y", math.radians(3.0))))
    made = lab.preflight()
    made.evidence = PROOF
    (finding,) = lab.findings(made)
    assert finding.check.key == "axes_unproven" and finding.check.blocks
    assert "was of another body: it lay 3.0 deg differently" in finding.text


def test_a_motion_by_hand_that_shows_a_mistake_refutes_the_proof():
    lab = Lab(axes_evidence="")
    made = lab.preflight()
    made.evidence = PROOF
    made.verdict = VERDICT._replace(mistake="x of the rigid body is not the nose")
    findings = {f.check.key: f for f in lab.findings(made)}
    assert "is not the nose" in findings["mocap_axes"].text
    record = made.take_evidence()
    assert record is not None and "is not the nose" in record.mistake
    assert made.evidence is None and made.take_evidence() is None


def test_a_proof_is_kept_with_its_date_once_the_vehicle_stands():
    lab = Lab(axes_evidence="", tracked_body="s500")
    made = lab.preflight()
    made.verdict = VERDICT
    assert lab.findings(made) == []
    record = made.take_evidence()
    assert (record.body, record.mistake) == ("s500", "")
    assert record.date.startswith("2025-11-2") and record.tilt_rad == pytest.approx(
        [0, 0], abs=0.01
    )


# --- parameters of PX4 --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("COM_OBL_RC_ACT", value) for value in (0, 1, 2, 3, 5, 6, 7)),
        ("COM_OF_LOSS_T", 0.1),
        ("COM_OF_LOSS_T", 10.0),
        ("EKF2_BARO_CTRL", 0),
        ("COM_DISARM_LAND", -1.0),
    ],
)
def test_parameters_with_which_a_loss_does_not_end_forbid_arming(lab, name, value):
    lab.values |= {name: value}
    (finding,) = (f for f in lab.findings() if f.check.key == "loss_parameters")
    assert finding.check.blocks
    assert f"{name} is {value:g}, set it to {SAFE_PARAMETERS[name]:g}" in finding.text
    assert "px4_parameters=safe" in finding.text
    lab.values |= parse_assignments(["safe"])
    assert lab.finding_keys() == set()
