import json

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from synthetic_flight import synthetic_flight, with_log

from tombo_bag.flight_time import nanoseconds
from tombo_bag.flight_topics import write_flight
from tombo_bag.formats.mcap_sink import McapSink
from tombo_bag.recording import Recording
from tombo_dynamics.time_base import EPOCH_NS

TICKS = 13_000
RATES_HZ = {
    "/imu/data_raw": 1000,
    "/rotor_command": 1000,
    "/odometry": 250,
    "/rates_setpoint": 250,
    "/ground_truth/odometry": 250,
    "/ground_truth/rotors": 250,
    "/attitude_setpoint": 50,
    "/tf": 50,
    "/battery": 10,
}


def xyz(table, path, axes="xyz"):
    return np.stack([table[f"{path}.{axis}"] for axis in axes], axis=1)


def write(path, flight):
    with McapSink(path) as sink:
        write_flight(sink, flight)
    return Recording(path)


FRAMES_OF_A_TRANSFORM = ("header.frame_id", "child_frame_id")


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


def test_a_mocap_pose_is_stamped_with_capture_and_logged_at_arrival(bag, flight):
    table = bag.columns("/mocap/pose")
    poses = flight["/mocap/pose"]
    np.testing.assert_array_equal(table["stamp_ns"], nanoseconds(poses.t))
    np.testing.assert_array_equal(table["log_time_ns"], nanoseconds(poses.arrival))
    np.testing.assert_array_equal(xyz(table, "pose.position"), poses["position"].values)
    turn = xyz(table, "pose.orientation", "xyzw")
    np.testing.assert_array_equal(turn, poses["attitude"].values)
    assert set(table["header.frame_id"]) == {"map"}


def test_values_arrive_unchanged(bag, flight):
    log = flight.log
    imu = bag.columns("/imu/data_raw")
    np.testing.assert_array_equal(xyz(imu, "angular_velocity"), log["gyro"])
    np.testing.assert_array_equal(xyz(imu, "linear_acceleration"), log["accel"])
    np.testing.assert_array_equal(bag.columns("/rotor_command")["speed"], log["rotor_command"])
    rotors = bag.columns("/ground_truth/rotors")
    for field in ("speed", "thrust"):
        np.testing.assert_array_equal(rotors[field], log[f"rotor_{field}"][::4])
    for field in ("fold", "damage"):
        np.testing.assert_array_equal(rotors[field], log[field][::4])
    truth = bag.columns("/ground_truth/odometry")
    np.testing.assert_array_equal(xyz(truth, "pose.pose.position"), log["position"][::4])
    rates = bag.columns("/rates_setpoint")
    np.testing.assert_array_equal(xyz(rates, "rates"), log["rates_setpoint"][::4])
    np.testing.assert_array_equal(rates["thrust"], log["thrust_setpoint"][::4, 0])
    current = bag.columns("/battery")["current"]
    np.testing.assert_array_equal(current, -log["battery"][::100, 1].astype(np.float32))
    tf = bag.columns("/tf")
    np.testing.assert_array_equal(
        xyz(tf, "transforms[1].transform.translation"), log["est_position"][::20]
    )
    chain = [set(tf[f"transforms[{i}].{n}"]) for i in (0, 1) for n in FRAMES_OF_A_TRANSFORM]
    assert chain == [{"map"}, {"odom"}, {"odom"}, {"base_link"}]
    assert (xyz(tf, "transforms[0].transform.rotation", "xyzw") == [0.0, 0.0, 0.0, 1.0]).all()


def test_what_the_cores_published_is_written_as_it_was(bag, flight):
    table, said = bag.columns("/odometry"), flight["/odometry"]
    np.testing.assert_array_equal(table["log_time_ns"], nanoseconds(said.arrival))
    np.testing.assert_array_equal(table["stamp_ns"], said["stamp_ns"].values)
    np.testing.assert_array_equal(xyz(table, "pose.pose.position"), said["position"].values)
    np.testing.assert_array_equal(xyz(table, "twist.twist.angular"), said["rates"].values)
    assert bag.columns("/mission/status")["text"].tolist() == ["approach"]


def test_set_points_are_those_of_ticks_in_which_the_loops_ran(flight, tmp_path):
    log = {**flight.log, "mode": np.where(flight.t[:, None] < 12.5, 0.0, 3.0)}
    bag = write(tmp_path / "a.mcap", with_log(flight, log))
    expected = nanoseconds(flight.t[12_500::4])
    np.testing.assert_array_equal(bag.columns("/rates_setpoint")["log_time_ns"], expected)


def test_contact_is_told_while_it_lasts_and_at_its_release(bag, flight):
    touching = np.flatnonzero(flight.log["contact"][:, 0])
    table = bag.columns("/ground_truth/contact")
    ticks = np.append(touching, touching[-1] + 1)
    np.testing.assert_array_equal(table["log_time_ns"], nanoseconds(flight.t[ticks]))
    assert table["in_contact"].tolist() == [True] * len(touching) + [False]
    np.testing.assert_array_equal(xyz(table, "force")[:-1], flight.log["contact_force"][touching])
    np.testing.assert_array_equal(xyz(table, "point")[:-1], flight.log["contact"][touching, 2:])
    assert table["rotor"].tolist() == [2] * len(touching) + [-1]


def test_markers_show_the_obstacle_then_x_c_then_x_r(bag):
    table = bag.columns("/markers")
    assert table["markers[0].ns"].tolist() == ["obstacle", "x_c", "x_r"]
    assert table["log_time_ns"][0] == EPOCH_NS
    assert [table[f"markers[0].scale.{a}"][0] for a in "xyz"] == [0.4, 0.4, 2.5]
    assert table["markers[0].pose.position.z"].tolist() == [1.25, 2.0, 2.0]
    assert (table["markers[0].pose.orientation.w"] == 1.0).all()
    assert (table["markers[0].color.a"] > 0.0).all()


def test_scenario_and_events_stand_in_the_metadata(bag):
    record = bag.metadata["tombo_flight"]
    assert json.loads(record["scenario"])["obstacle"]["radius_m"] == 0.2
    assert json.loads(record["events"])[0]["kind"] == "takeoff"
    assert int(record["epoch_ns"]) == EPOCH_NS


@pytest.mark.parametrize("ticks", [0, 1, 3, 999, 1000])
def test_a_flight_that_was_broken_off_is_written_as_far_as_it_went(ticks, tmp_path):
    bag = write(tmp_path / "a.mcap", synthetic_flight(ticks))
    assert bag.damage == []
    assert bag.topics["/imu/data_raw"].count == ticks
    assert bag.topics["/odometry"].count == (ticks + 3) // 4
    assert bag.topics["/markers"].count == 1
    with AnyReader([bag.path]) as reader:
        assert len(list(reader.messages())) == sum(t.count for t in bag.topics.values())
