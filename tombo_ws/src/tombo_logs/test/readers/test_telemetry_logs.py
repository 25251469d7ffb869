"""Telemetry logs, packed by pymavlink."""

import struct

import numpy as np
import pytest
from log_writers import close
from made_flight import made_flight
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2
from scipy.spatial.transform import Rotation

from tombo_logs.readers.log_reader import read_logs

FLIGHT = made_flight(duration=3.0, mocap_hz=50.0, imu_hz=50.0)
P, Q = FLIGHT.series["position"], FLIGHT.series["attitude"].values
SPEED = np.abs(FLIGHT.series["rotor_speed"].values)
RPM = SPEED * 30.0 / np.pi
SHARE = np.clip(SPEED / 800.0, 0.0, 1.0)
EPOCH_US = 1_700_000_000_000_000
NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FRD = np.diag([1.0, -1.0, -1.0])
TURN = Rotation.from_matrix(NED @ Rotation.from_quat(Q).as_matrix() @ FRD)
PLACE = P.values @ NED.T


def written(path, dialect, mocap=True, escs="telemetry"):
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    companion = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
    ground = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    out = []

    def log(t, frame):
        out.append(struct.pack(">Q", EPOCH_US + round((t + 0.02) * 1e6)) + frame)

    for i, t in enumerate(P.t):
        us, ms = round((t + 50.0) * 1e6), round((t + 50.0) * 1e3)
        x, y, z, w = TURN[i].as_quat()
        yaw, pitch, roll = TURN[i].as_euler("ZYX")
        gyro, accel = (FLIGHT.series[c].values[i] @ FRD for c in ("gyro", "accel"))
        if i % 25 == 0:
            log(t, ground.heartbeat_encode(6, 8, 0, 0, 0, 3).pack(ground))
        if mocap == "odometry":
            pose, rest = (*PLACE[i], [w, x, y, z]), (*[0.0] * 6, [0.0] * 21, [0.0] * 21)
            log(t, companion.odometry_encode(us, 1, 8, *pose, *rest, 0, 2).pack(companion))
            pose = (*(PLACE[i] + 1.0), [w, x, y, z])  # the autopilot's own estimate
            log(t, link.odometry_encode(us, 1, 8, *pose, *rest, 0, 8).pack(link))
        elif mocap:
            log(t, companion.vicon_position_estimate_encode(
                us, *PLACE[i], roll, pitch, yaw).pack(companion))  # fmt: skip
        else:
            log(t, link.local_position_ned_encode(ms, *PLACE[i], 0, 0, 0).pack(link))
            log(t, link.attitude_quaternion_encode(ms, w, x, y, z, 0, 0, 0).pack(link))
        log(t, link.highres_imu_encode(us, *accel, *gyro, *[0.0] * 7, 63).pack(link))
        pulses = [round(1000.0 + 1000.0 * s) for s in SHARE[i]]
        log(t, link.servo_output_raw_encode(us, 0, *pulses, 0, 0, 0, 0).pack(link))
        volts = link.sys_status_encode(0, 0, 0, 0, 12_340, 700, 50, 0, 0, 0, 0, 0, 0)
        log(t, volts.pack(link))
        if escs == "telemetry":
            four = [0] * 4
            rpm = [round(x) for x in RPM[i]]
            log(t, link.esc_telemetry_1_to_4_encode(four, four, four, four, rpm, four).pack(link))
    path.write_bytes(b"".join(out))
    return path


@pytest.mark.parametrize(("dialect", "escs"), [(v2, "telemetry"), (v1, "none")])
def test_poses_imu_rotors_and_supply_come_back(tmp_path, dialect, escs):
    (log,) = read_logs([written(tmp_path / "a.tlog", dialect, escs=escs)])
    close(log.series["position"].values, P.values, 1e-6)
    turns = Rotation.from_quat(log.series["attitude"].values).inv() * Rotation.from_quat(Q)
    assert turns.magnitude().max() < 1e-6
    for channel in ("gyro", "accel"):
        close(log.series[channel].values, FLIGHT.series[channel].values, 1e-5)
    close(log.series["motor_command"].values, SHARE, 6e-4)
    close(log.series["voltage"].values, 12.34)
    close(log.series["current"].values, 7.0)
    assert ("rotor_speed" in log.series) == (escs != "none")
    if escs != "none":
        close(log.series["rotor_speed"].values, SPEED, 0.06)
    assert not log.findings


def test_without_motion_capture_the_estimate_is_taken_and_said(tmp_path):
    (log,) = read_logs([written(tmp_path / "a.tlog", v2, mocap=False)])
    close(log.series["position"].values, P.values, 1e-6)
    assert any("estimate" in f.message for f in log.findings)


def test_odometry_of_a_companion_is_the_pose_and_that_of_the_autopilot_is_not(tmp_path):
    (log,) = read_logs([written(tmp_path / "a.tlog", v2, mocap="odometry")])
    close(log.series["position"].values, P.values, 1e-6)
    turns = Rotation.from_quat(log.series["attitude"].values).inv() * Rotation.from_quat(Q)
    assert turns.magnitude().max() < 1e-6
