"""Mappings that are proposed for foreign tables, by names, units and sizes."""

import re

import foreign_tables as tables
import numpy as np
import pytest
from log_writers import write_ulog
from scipy.spatial.transform import Rotation

from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.proposal.explain import explain_mapping
from tombo_logs.proposal.names import parse_column_name
from tombo_logs.proposal.propose import propose
from tombo_logs.readers.csv_mapping import parse_mapping
from tombo_logs.readers.log_reader import read_log


def proposed(path, content):
    """The text that is proposed for a file, and the flight as read with it."""
    path.write_text(content, encoding="utf-8")
    text = explain_mapping(path)
    return text, read_log(path, "a", parse_mapping(text, "m"))


def doubtful_lines(text):
    """Keys of the lines that are marked as doubtful."""
    return re.findall(r"DOUBTFUL:(?:.*\n)(?:\s*#.*\n)*\s*(\w+):", text)


FLIGHT_TABLE = {
    "position": (tables.P, 1e-9),
    "gyro": (tables.GYRO, 1e-9),
    "accel": (tables.ACCEL, 1e-9),
    "motor_command": (tables.SHARE, 1e-3),  # in our order
    "voltage": (4.1 - 0.02 * tables.T[:, None], 1e-9),
}
"""Channel → its values, and how far they may be off."""


@pytest.mark.slow
def test_a_crazyflies_table_gives_back_its_flight(tmp_path):
    """Its own estimate is not a motion capture; its weight is not in the file."""
    text, log = proposed(tmp_path / "a.csv", tables.crazyflie())
    for channel in ("position", "gyro", "accel", "motor_command", "voltage"):
        values, tolerance = FLIGHT_TABLE[channel]
        np.testing.assert_allclose(log.series[channel].values, values, atol=tolerance)
    turns = Rotation.from_quat(log.series["attitude"].values).inv() * tables.TURN
    assert turns.magnitude().max() < 1e-6
    assert doubtful_lines(text) == ["position", "attitude", "gyro", "voltage", "airframe"]
    assert np.ptp(log.series["position"].t) == pytest.approx(np.ptp(tables.T), abs=0.02)


@pytest.mark.slow
def test_axes_are_doubtful_and_the_checks_say_that_they_are_wrong(tmp_path):
    """PX4's world is NED, its body FRD: no name of a column says so."""
    path = tmp_path / "a.csv"
    path.write_text(tables.px4())
    text = explain_mapping(path)
    channels = parse_mapping(text, "m").channels
    assert channels["attitude"].order == "wxyz" and channels["rotor_speed"].unit == "rpm"
    assert (channels["gyro"].unit, channels["accel"].unit) == ("rad/s", "m/s^2")
    assert channels["motor_command"].range == (0.0, 1.0)
    assert {"world", "body", "attitude", "motor_command"} <= set(doubtful_lines(text))
    assert re.search(r"The checks say: .*(NED|FRD|upside)", " ".join(text.split()))


@pytest.mark.parametrize("beside", ["state.p", "payload.pos_", "cable_pos_"])
def test_a_place_without_attitude_is_the_vehicles_and_in_its_unit(beside):
    """Whole millimetres, with columns of a payload."""
    columns = {"t": tables.T, **tables.named([f"state.{a}" for a in "xyz"], 1e3 * tables.P)}
    columns = {name: np.round(c) if "state" in name else c for name, c in columns.items()}
    columns |= tables.named([f"{beside}{a}" for a in "xyz"], np.round(1e3 * tables.P - 300.0))
    (line,) = propose(columns).channels
    assert line.content == {"columns": ["state.x", "state.y", "state.z"], "unit": "mm"}


def test_the_stamp_of_the_header_is_the_time_before_that_of_arrival():
    """As `rostopic echo -p` names them."""
    columns = {"time": 1e9 * tables.T + 7e6, "field.header.stamp": 1e9 * tables.T}
    columns |= tables.named([f"field.pose.position.{a}" for a in "xyz"], tables.P)
    columns |= tables.named([f"field.pose.orientation.{a}" for a in "xyzw"], tables.Q)
    time, *_ = propose(columns).axes
    assert time.content == {"column": "field.header.stamp", "unit": "ns"}


def test_what_is_not_there_is_said_and_nothing_is_made_up(tmp_path):
    """Pitch was not logged, and the acceleration is without gravity."""
    acceleration = tables.TURN.apply(tables.ACCEL) / GRAVITY - [0.0, 0.0, 1.0]
    columns = {
        "t_s": tables.T,
        **tables.named(["x_m", "y_m", "z_m"], tables.P),
        **tables.named(["ax_g", "ay_g", "az_g"], acceleration),
        "roll_deg": np.sin(tables.T), "yaw_deg": 20.0 + np.cos(tables.T),
        **tables.named([f"command_m{i}" for i in range(1, 5)], np.round(65535.0 * tables.SHARE)),
    }  # fmt: skip
    path = tmp_path / "pad.csv"
    path.write_text(tables.rows(columns))
    text = explain_mapping(path)
    assert set(parse_mapping(text, "m").channels) == {"position", "motor_command"}
    assert "pitch not there" in text and "ax_g, ay_g, az_g: median size" in text


@pytest.mark.parametrize(
    ("raw", "parts"),
    [
        ("a_RS_S_x [m s^-2]", (("a", "rs", "s"), "x", None, "m/s^2")),
        ("imu_gyro_y", (("imu", "gyro"), "y", None, "")),
        ("esc_status.esc[2].esc_rpm", (("esc", "status", "esc", "esc"), "", 2, "rpm")),
        ("sensor.accelerometer_m_s2[1]", (("sensor", "accelerometer"), "", 1, "m/s^2")),
        ("/vehicle_attitude/q.03", (("vehicle", "attitude", "q"), "", 3, "")),
        ("stateEstimate.qw", (("state", "estimate", "q"), "w", None, "")),
        ("battery_mV", (("battery",), "", None, "mV")),
        ("motor.m4", (("motor", "m"), "", 4, "")),
        ("GyrX", (("gyr",), "x", None, "")),
        ("w1", (("w",), "", 1, "")),
        ("heading (deg)", ((), "yaw", None, "deg")),
    ],
)
def test_names_are_taken_apart(raw, parts):
    assert parse_column_name(raw) == parts


@pytest.mark.slow
def test_a_log_that_needs_no_mapping(tmp_path):
    write_ulog(tmp_path / "a.ulg", tables.FLIGHT)
    text = explain_mapping(tmp_path / "a.ulg")
    assert not parse_mapping(text, "m").channels
    assert "rotor_speed: " in text and "vehicle_visual_odometry" in text


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is empty"),
        (b"\x89MCAP0\r\n", "has no poses|holds no"),
        (b"a,b\n", "no row of numbers|no column"),
        (b"name,kind\nfoo,bar\nfoo,bar\n", "no column of numbers"),
        (b"t,px,py\n" + b"5,1,2\n" * 40, "no column of times"),
        (b"t,px,py\n" + b"nan,1,2\n" * 40, "no column of times"),
        (b"t,t,px\n" + b"1,1,2\n2,2,2\n" * 40, "no column of times"),
    ],
)
def test_what_can_not_be_used_is_said_in_a_line(tmp_path, content, complaint):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=complaint) as error:
        explain_mapping(path)
    assert "\n" not in str(error.value)
