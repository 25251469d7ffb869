import dataclasses
import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from synthetic_flight import synthetic_flight

from tombo_bag.flight_time import nanoseconds
from tombo_bag.flight_topics import heading, write_flight
from tombo_bag.mcap_sink import McapSink
from tombo_bag.reader import Bag
from tombo_dynamics.rotation import map_to_body
from tombo_dynamics.time_base import EPOCH_NS

TICKS = 13_000
RATES_HZ = {
    "/imu/data_raw": 1000,
    "/rotor_command": 1000,
    "/odometry": 250,
    "/rates_setpoint": 250,
    "/ground_truth/odometry": 250,
    "/ground_truth/rotors": 250,
    "/mission/setpoint": 50,
    "/setpoint": 50,
    "/attitude_setpoint": 50,
    "/tf": 50,
    "/battery": 10,
}


def xyz(table, path, axes="xyz"):
    return np.stack([table[f"{path}.{axis}"] for axis in axes], axis=1)


def write(path, flight):
    with McapSink(path) as sink:
        write_flight(sink, flight)
    return Bag(path, check=True)


@pytest.fixture(scope="module")
def flight():
    return synthetic_flight(TICKS)


@pytest.fixture(scope="module")
def bag(flight, tmp_path_factory):
    return write(tmp_path_factory.mktemp("flight") / "flight.mcap", flight)


@pytest.mark.slow
@pytest.mark.parametrize(("topic", "rate_hz"), RATES_HZ.items())
def test_streams_have_their_rate_and_their_stamps(bag, topic, rate_hz):
    table = bag.columns(topic)
    expected = np.arange(0, TICKS, 1000 // rate_hz) * 1_000_000 + EPOCH_NS
    np.testing.assert_array_equal(table["log_time_ns"], expected)
    prefix = "transforms[0]." if topic == "/tf" else ""
    stamps = table[f"{prefix}header.stamp.sec"].astype(np.int64) * 10**9
    np.testing.assert_array_equal(stamps + table[f"{prefix}header.stamp.nanosec"], expected)


@pytest.mark.slow
def test_every_message_is_decoded_by_the_libraries(bag):
    number = sum(topic.count for topic in bag.topics.values())
    with bag.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        decoded = [(m.channel.topic, m.decoded_message) for m in reader.iter_decoded_messages()]
    assert len(decoded) == number
    with AnyReader([bag.path]) as reader:
        messages = [
            (c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()
        ]
    assert [topic for topic, _ in messages] == [topic for topic, _ in decoded]
    for (topic, one), (_, other) in zip(messages[::37], decoded[::37], strict=True):
        if topic == "/imu/data_raw":
            assert one.linear_acceleration.z == other.linear_acceleration.z
            assert one.orientation_covariance[0] == -1.0
            assert one.header.frame_id == other.header.frame_id == "base_link"


def test_a_mocap_pose_is_stamped_with_capture_and_logged_at_arrival(bag, flight):
    table = bag.columns("/mocap/pose")
    np.testing.assert_array_equal(table["stamp_ns"], nanoseconds(flight.mocap_t))
    np.testing.assert_array_equal(table["log_time_ns"], nanoseconds(flight.mocap_arrival))
    np.testing.assert_array_equal(xyz(table, "pose.position"), flight.mocap_position)
    np.testing.assert_array_equal(xyz(table, "pose.orientation", "xyzw"), flight.mocap_attitude)
    assert set(table["header.frame_id"]) == {"map"}


def test_poses_that_never_arrived_are_left_out(flight, tmp_path):
    arrival = flight.mocap_arrival.copy()
    arrival[3] = np.nan
    bag = write(tmp_path / "a.mcap", dataclasses.replace(flight, mocap_arrival=arrival))
    assert bag.topics["/mocap/pose"].count == len(arrival) - 1


def test_values_arrive_unchanged(bag, flight):
    log = flight.log
    imu = bag.columns("/imu/data_raw")
    np.testing.assert_array_equal(xyz(imu, "angular_velocity"), log["gyro"])
    np.testing.assert_array_equal(xyz(imu, "linear_acceleration"), log["accel"])
    np.testing.assert_array_equal(bag.columns("/rotor_command")["speed"], log["rotor_command"])
    rotors = bag.columns("/ground_truth/rotors")
    for field, column in {
        "speed": "rotor_speed",
        "thrust": "rotor_thrust",
        "fold": "fold",
        "damage": "damage",
    }.items():
        np.testing.assert_array_equal(rotors[field], log[column][::4])
    setpoint = bag.columns("/setpoint")
    np.testing.assert_array_equal(xyz(setpoint, "position"), log["position_setpoint"][::20])
    np.testing.assert_array_equal(xyz(setpoint, "velocity"), log["velocity_setpoint"][::20])
    fed = xyz(setpoint, "acceleration")
    np.testing.assert_array_equal(fed, log["acceleration_setpoint"][::20])
    np.testing.assert_array_equal(setpoint["phase"], log["mode"][::20, 0])
    truth = bag.columns("/ground_truth/odometry")
    np.testing.assert_array_equal(xyz(truth, "pose.pose.position"), log["position"][::4])
    estimate = bag.columns("/odometry")
    np.testing.assert_array_equal(
        xyz(estimate, "pose.pose.orientation", "xyzw"), log["est_attitude"][::4]
    )
    rates = bag.columns("/rates_setpoint")
    np.testing.assert_array_equal(xyz(rates, "rates"), log["rates_setpoint"][::4])
    np.testing.assert_array_equal(rates["thrust"], log["thrust_setpoint"][::4, 0])
    tf = bag.columns("/tf")
    np.testing.assert_array_equal(
        xyz(tf, "transforms[0].transform.translation"), log["est_position"][::20]
    )
    assert set(tf["transforms[0].child_frame_id"]) == {"base_link"}


def test_twist_is_given_in_the_body_frame():
    """Facing north (yaw 90 deg), flying east is flying to the right: -y of FLU."""
    north = np.array([[0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]])
    np.testing.assert_allclose(
        map_to_body(north, np.array([[2.0, 0.0, 0.0]])), [[0, -2, 0]], atol=1e-12
    )
    # nose down by 90 deg, falling is flying forward
    down = np.array([[0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]])
    np.testing.assert_allclose(
        map_to_body(down, np.array([[0.0, 0.0, -3.0]])), [[3, 0, 0]], atol=1e-12
    )
    assert heading(north) == pytest.approx([np.pi / 2])


def test_twist_has_the_speed_of_the_velocity(bag, flight):
    twist = xyz(bag.columns("/ground_truth/odometry"), "twist.twist.linear")
    np.testing.assert_allclose(
        np.linalg.norm(twist, axis=1), np.linalg.norm(flight.log["velocity"][::4], axis=1)
    )


def test_contact_is_told_while_it_lasts_and_at_its_release(bag, flight):
    touching = np.flatnonzero(flight.log["contact"][:, 0])
    table = bag.columns("/ground_truth/contact")
    ticks = np.append(touching, touching[-1] + 1)
    np.testing.assert_array_equal(table["log_time_ns"], nanoseconds(flight.t[ticks]))
    assert table["in_contact"].tolist() == [True] * len(touching) + [False]
    np.testing.assert_array_equal(xyz(table, "force")[:-1], flight.log["contact_force"][touching])
    np.testing.assert_array_equal(xyz(table, "point")[:-1], flight.log["contact"][touching, 2:])
    assert table["rotor"].tolist() == [2] * len(touching) + [-1]


def test_contact_is_found_by_its_force_alone(flight, tmp_path):
    log = {name: column for name, column in flight.log.items() if name != "contact"}
    bag = write(tmp_path / "a.mcap", dataclasses.replace(flight, log=log))
    table = bag.columns("/ground_truth/contact")
    assert table["in_contact"].sum() == (flight.log["contact_force"] != 0).any(axis=1).sum()
    assert np.isnan(table["point.x"]).all()


def test_collision_event(bag):
    table = bag.columns("/collision_event")
    assert table["log_time_ns"].tolist() == [13_050_000_000]
    assert table["stamp_ns"].tolist() == [13_040_000_000]
    assert table["trigger"].tolist() == [2]
    assert (table["contact_stamp.sec"][0], table["contact_stamp.nanosec"][0]) == (13, 10_000_000)
    assert xyz(table, "contact_position").tolist() == [[1.7, 0.0, 2.0]]
    assert xyz(table, "flight_direction").tolist() == [[1.0, 0.0, 0.0]]
    assert [table[key][0] for key in ("confidence", "statistic", "count")] == [0.9, 31.0, 1]


def test_reaction_status_begins_idle_and_changes_with_the_setpoint(bag):
    table = bag.columns("/reaction/status")
    assert table["state"].tolist() == [0, 1]
    assert table["collisions"].tolist() == [0, 1]
    assert np.isnan(table["x_c.x"][0])
    assert xyz(table, "x_r")[1].tolist() == [0.9, 0.0, 2.0]
    assert xyz(table, "n_r")[1].tolist() == [-1.0, 0.0, 0.0]


def test_descending_blind_is_a_reaction_too(flight, tmp_path):
    log = {**flight.log, "mode": np.where(flight.t[:, None] > 12.5, 8.0, 3.0)}
    bag = write(tmp_path / "a.mcap", dataclasses.replace(flight, log=log))
    assert bag.columns("/reaction/status")["state"].tolist() == [0, 1, 2]
    assert bag.columns("/mission/status")["text"].tolist() == ["approach", "descend_blind"]


def test_mission_status_follows_the_mode(bag, flight):
    table = bag.columns("/mission/status")
    assert table["phase"].tolist() == [0, 1, 2, 3, 4]
    assert table["text"].tolist() == ["idle", "takeoff", "hover", "approach", "react"]
    mode = flight.log["mode"][:, 0]
    changed = flight.t[np.flatnonzero(np.diff(mode)) + 1]
    np.testing.assert_array_equal(table["log_time_ns"][1:], nanoseconds(changed))


def test_markers_show_the_obstacle_then_x_c_then_x_r(bag):
    table = bag.columns("/markers")
    assert table["markers[0].ns"].tolist() == ["obstacle", "x_c", "x_r"]
    assert table["log_time_ns"][0] == EPOCH_NS
    assert [table[f"markers[0].scale.{a}"][0] for a in "xyz"] == [0.4, 0.4, 2.5]
    assert table["markers[0].pose.position.z"].tolist() == [1.25, 2.0, 2.0]
    assert (table["markers[0].pose.orientation.w"] == 1.0).all()
    assert (table["markers[0].color.a"] > 0.0).all()


def test_battery_current_is_negative_while_discharging(bag, flight):
    table = bag.columns("/battery")
    np.testing.assert_array_equal(table["voltage"], flight.log["battery"][::100, 2].astype("f4"))
    assert (table["current"] <= 0.0).all()
    assert np.isnan(table["percentage"]).all()


def test_scenario_and_events_stand_in_the_metadata(bag):
    (record,) = bag.metadata
    assert record.name == "tombo_flight"
    assert json.loads(record.metadata["scenario"])["obstacle"]["radius_m"] == 0.2
    assert json.loads(record.metadata["events"])[0]["kind"] == "takeoff"
    assert int(record.metadata["epoch_ns"]) == EPOCH_NS


def test_mission_setpoint_is_the_one_before_the_reaction(flight, tmp_path):
    mission = np.ones((TICKS, 3))
    log = {**flight.log, "mission_setpoint": mission}
    bag = write(tmp_path / "a.mcap", dataclasses.replace(flight, log=log))
    assert (xyz(bag.columns("/mission/setpoint"), "position") == 1.0).all()
    assert not (xyz(bag.columns("/setpoint"), "position") == 1.0).any()


@pytest.mark.parametrize("ticks", [0, 1, 3, 999, 1000])
def test_a_flight_that_was_broken_off_is_written_as_far_as_it_went(ticks, tmp_path):
    bag = write(tmp_path / "a.mcap", synthetic_flight(ticks))
    assert bag.damage == ()
    assert bag.topics["/imu/data_raw"].count == ticks
    assert bag.topics["/odometry"].count == (ticks + 3) // 4
    assert bag.topics["/markers"].count == 1
    with AnyReader([bag.path]) as reader:
        assert len(list(reader.messages())) == sum(t.count for t in bag.topics.values())


@pytest.mark.slow
def test_missing_columns_leave_out_their_topics_alone(flight, tmp_path):
    whole = set(write(tmp_path / "a.mcap", flight).topics)
    for name in flight.log:
        log = {key: column for key, column in flight.log.items() if key != name}
        bag = write(tmp_path / "a.mcap", dataclasses.replace(flight, log=log))
        assert len(whole - set(bag.topics)) <= 4
    nothing = write(tmp_path / "a.mcap", dataclasses.replace(flight, log={}, scenario={}))
    assert nothing.topics["/mocap/pose"].count == len(flight.mocap_t)


@pytest.mark.slow
def test_same_flight_gives_the_same_bytes(flight, tmp_path):
    for name in ("a", "b"):
        write(tmp_path / f"{name}.mcap", flight)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@pytest.mark.slow
def test_log_columns_may_be_views_of_one_large_table(flight, tmp_path):
    """The simulator logs a row per tick; its columns are not contiguous."""
    table = np.concatenate(list(flight.log.values()), axis=1)
    edges = np.cumsum([0] + [column.shape[1] for column in flight.log.values()])
    log = {name: table[:, a:b] for name, a, b in zip(flight.log, edges, edges[1:], strict=False)}
    write(tmp_path / "a.mcap", flight)
    write(tmp_path / "b.mcap", dataclasses.replace(flight, log=log))
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
