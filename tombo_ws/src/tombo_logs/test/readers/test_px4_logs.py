"""PX4 logs, written here byte by byte."""

import numpy as np
import pytest
from log_writers import write_ulog
from made_flight import made_flight
from scipy.spatial.transform import Rotation

from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.readers.ulog import read_ulog

FLIGHT = made_flight(duration=6.0, mocap_hz=50.0, imu_hz=100.0)


def close(a, b, tolerance=1e-5):
    np.testing.assert_allclose(a, b, atol=tolerance)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.ulg"


def test_everything_comes_back_in_our_frames_and_units(path):
    write_ulog(path, FLIGHT)
    log = read_ulog(path, "a")
    position, attitude = log.series["position"], log.series["attitude"]
    start = 1.0  # the log began a second before
    close(position.t, FLIGHT.series["position"].t + start)
    close(position.arrival - position.t, 0.02)
    close(position.values, FLIGHT.series["position"].values)
    turns = Rotation.from_quat(attitude.values).inv() * Rotation.from_quat(
        FLIGHT.series["attitude"].values
    )
    assert turns.magnitude().max() < 1e-6
    for name, shift in (("gyro", -0.0025), ("accel", -0.0035)):
        # means over 5 ms that end at the stamp; the accelerometer's ends 1 ms earlier
        close(log.series[name].t, FLIGHT.series[name].t + start + shift)
        close(log.series[name].values, FLIGHT.series[name].values)
    close(log.series["rotor_speed"].values, np.abs(FLIGHT.series["rotor_speed"].values), 0.06)
    command = np.clip(FLIGHT.series["rotor_command"].values / 800.0, 0.0, 1.0)
    close(log.series["motor_command"].values, command)
    close(log.series["motor_command"].t, FLIGHT.series["gyro"].t + start)
    close(log.series["voltage"].values, FLIGHT.series["voltage"].values)
    close(log.series["current"].values, 7.0)


def test_a_sample_later_than_its_message_is_of_another_clock(path):
    write_ulog(path, FLIGHT, age_us=-1_500_000)
    log = read_ulog(path, "a")
    (said,) = [f for f in log.findings if f.key == "sample later"]
    assert said.channel == "vehicle_visual_odometry" and said.numbers[0] == pytest.approx(1.5)
    close(log.series["position"].t, FLIGHT.series["position"].t - 1.5 + 1.0)


def test_the_checks_find_nothing_wrong_with_it(path):
    write_ulog(path, made_flight(duration=12.0, mocap_hz=50.0))
    log = check_log(read_ulog(path, "a"))
    assert not [f for f in log.findings if f.severity != "info"]
    assert {"gyro", "accel", "rotor_speed"} <= set(log.series)


def test_without_motion_capture_the_estimate_is_taken_and_said(path):
    write_ulog(path, FLIGHT, mocap=False, estimate=True)
    log = read_ulog(path, "a")
    close(log.series["position"].values, FLIGHT.series["position"].values)
    assert log.series["position"].arrival is None
    assert any("estimate" in f.message and f.check == "missing" for f in log.findings)


def test_without_poses_what_is_needed_is_said(path):
    write_ulog(path, FLIGHT, mocap=False)
    with pytest.raises(InputError, match=r"needed: position and attitude.*sensor_combined"):
        read_ulog(path, "a")


@pytest.mark.parametrize("share", [0.001, 0.5])
def test_a_cut_log_is_read_as_far_as_it_goes_or_refused(path, share):
    write_ulog(path, FLIGHT)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole)) + 5])
    if share < 0.1:
        with pytest.raises(InputError):
            read_ulog(path, "a")
        return
    log = read_ulog(path, "a")
    assert log.series["position"].t.size < FLIGHT.series["position"].t.size
    assert any("cut off" in f.message for f in log.findings)


def test_what_px4_asked_for_and_its_modes_come_along(path):
    out = write_ulog(path, FLIGHT)
    stamps = np.array([3_000_000, 5_000_000])
    names = ("x", "y", "z")
    wanted = np.array([[1.0, 2.0, -3.0], [4.0, 5.0, -6.0]])  # NED
    fields = [f"float {name}" for name in names]
    out.topic("vehicle_local_position_setpoint", fields, wanted.T, stamps)
    rates = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])  # FRD
    fields = [f"float {name}" for name in ("roll", "pitch", "yaw")]
    out.topic("vehicle_rates_setpoint", fields, rates.T, stamps)
    fields = ["uint8_t nav_state", "uint8_t arming_state"]
    out.topic("vehicle_status", fields, [[4, 14], [1, 2]], stamps)
    path.write_bytes(out.content())
    log = read_ulog(path, "a")
    setpoint = log.topics["/setpoint"]["position"]
    close(setpoint.t, [2.0, 4.0])
    close(setpoint.values, [[2.0, 1.0, 3.0], [5.0, 4.0, 6.0]])
    close(log.topics["/rates_setpoint"]["rates"].values[0], [0.1, -0.2, -0.3])
    assert [(e["time_s"], e["text"]) for e in log.events] == [
        *((2.0, "hold"), (2.0, "disarmed")),
        *((4.0, "offboard"), (4.0, "armed")),
    ]
    assert {"position", "attitude"} <= set(log.series)
