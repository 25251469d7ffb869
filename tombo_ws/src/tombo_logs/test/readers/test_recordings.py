"""Recordings of ROS messages: topics, clocks, and what must not be read."""

import shutil

import numpy as np
import pytest
from log_writers import EPOCH_NS, close, write_bag
from made_flight import BAGS, made_flight, poses_only

from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_logs.readers.bag_log import read_bag
from tombo_logs.readers.log_reader import read_logs

FLIGHT = made_flight(duration=6.0, mocap_hz=50.0, imu_hz=200.0)


def test_all_channels_come_back_with_stamps_and_arrivals(tmp_path):
    write_bag(tmp_path / "a.mcap", FLIGHT)
    log = read_bag(tmp_path / "a.mcap", "a")
    assert set(log.series) == {*FLIGHT.series, "current"} - {"rotor_speed"}
    for name in set(log.series) & set(FLIGHT.series):
        close(log.series[name].t, FLIGHT.series[name].t, 2e-9)
        close(log.series[name].values, FLIGHT.series[name].values, 1e-6)
    close(log.series["position"].arrival - log.series["position"].t, 0.01)
    close(log.series["current"].values, 8.0)  # drawn from the battery: positive here
    assert log.airframe is None and not log.findings


def test_the_truth_is_never_read(tmp_path):
    """The ground truth of this recording is wrong by 99 m: nothing of it may be seen."""
    write_bag(tmp_path / "a.mcap", FLIGHT, truth=True)
    log = read_bag(tmp_path / "a.mcap", "a")
    assert log.series["position"].values.max() < 10.0
    with pytest.raises(InputError, match="must not see"):
        read_bag(tmp_path / "a.mcap", "a", {"/ground_truth/pose": "/mocap/pose"})


def test_of_a_scenario_only_the_name_is_kept():
    log = read_bag(BAGS / "paper_collision_0.mcap", "a")
    assert log.metadata == {"scenario": "paper_collision"}
    with Recording(BAGS / "paper_collision_0.mcap") as recording:
        assert recording.columns("/ground_truth/contact")["log_time_ns"].size
    assert set(log.series) == {"position", "attitude"}


@pytest.mark.parametrize(
    "pose",
    [
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
        "nav_msgs/msg/Odometry",
    ],
)
def test_poses_of_any_type_are_read_under_a_given_name(tmp_path, pose):
    write_bag(tmp_path / "a.mcap", FLIGHT, pose=pose, topic="/vrpn/drone/pose")
    log = read_bag(tmp_path / "a.mcap", "a", {"/vrpn/drone/pose": "/mocap/pose"})
    close(log.series["position"].values, FLIGHT.series["position"].values)
    close(log.series["attitude"].values, FLIGHT.series["attitude"].values)


def test_topics_under_a_namespace_are_found(tmp_path):
    write_bag(tmp_path / "a.mcap", FLIGHT, namespace="/drone7")
    assert {"gyro", "rotor_command"} <= set(read_bag(tmp_path / "a.mcap", "a").series)


def test_poses_under_another_name_are_suggested(tmp_path):
    write_bag(tmp_path / "a.mcap", poses_only(FLIGHT), topic="/vicon/drone")
    with pytest.raises(InputError, match="/vicon/drone:=/mocap/pose"):
        read_bag(tmp_path / "a.mcap", "a")


def test_stamps_of_another_clock_are_shifted_and_said(tmp_path):
    write_bag(tmp_path / "a.mcap", FLIGHT, pose_clock_ns=-400 * 10**9)
    log = read_bag(tmp_path / "a.mcap", "a")
    close(log.series["position"].t, FLIGHT.series["position"].t + 0.01, 1e-6)
    close(log.series["gyro"].t, FLIGHT.series["gyro"].t, 1e-6)
    assert [(f.check, f.channel) for f in log.findings] == [("stamps", "/mocap/pose")]


def test_one_clock_for_all_stamps_keeps_their_delays(tmp_path):
    """Simulated time: every stamp is far from the recorder's clock, by the same amount."""
    write_bag(tmp_path / "a.mcap", poses_only(FLIGHT), pose_clock_ns=-EPOCH_NS + 5 * 10**9)
    log = read_bag(tmp_path / "a.mcap", "a")
    assert not log.findings
    assert np.diff(log.series["position"].t) == pytest.approx(0.02)


def test_a_folder_of_flights_is_several_and_a_rosbag2_folder_is_one(tmp_path):
    for name in ("aggressive_2", "no_obstacle_1"):
        shutil.copy(BAGS / f"{name}.mcap", tmp_path)
    assert [log.name for log in read_logs([tmp_path])] == ["aggressive_2", "no_obstacle_1"]
    run = tmp_path / "run-3"
    run.mkdir()
    shutil.copy(BAGS / "no_obstacle_1.mcap", run / "flight.mcap")
    (log,) = read_logs([run])
    assert log.name == "run-3" and not log.findings
