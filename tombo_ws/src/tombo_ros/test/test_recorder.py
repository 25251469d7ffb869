"""The recorder as its own process, over DDS: written and lost messages, and its files after its
death."""

from __future__ import annotations

import os
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed")
pytest.importorskip("tombo_msgs.msg", reason="tombo_msgs is not built")

from mcap.reader import make_reader  # noqa: E402
from mcap_ros2.decoder import DecoderFactory  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from rosbags.highlevel import AnyReader  # noqa: E402

from tombo_bag.flight_time import RECORDER_METADATA  # noqa: E402
from tombo_bag.formats.reader import Bag  # noqa: E402
from tombo_bag.qos import SENSOR, Qos  # noqa: E402
from tombo_bag.recording import Recording  # noqa: E402
from tombo_bag.topics import COLLISION_EVENT, DIAGNOSTICS, IMU, ODOMETRY, TopicSpec  # noqa: E402
from tombo_ros.conversion import to_time  # noqa: E402
from tombo_ros.topic import message_class  # noqa: E402

STEADY = TopicSpec("/steady", IMU.typename, Qos(5000), 0.0, "reliable, so busy machines lose none")
RECORDER = "tombo_ros.recorder_node"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MS = 1_000_000


def record(start, folder, *more):
    return start(RECORDER, "-p", f"output:={folder}", *more)


def decoded(path: Path, topic: str) -> list:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(m, values) for _, _, m, values in reader.iter_decoded_messages([topic])]


def imu(number: int):
    message = message_class(IMU.typename)()
    message.header.stamp = to_time(number * MS)
    message.header.frame_id = "base_link"
    message.angular_velocity.x = float(number)
    return message


def meet(world, *specs, others: int = 1) -> None:
    """Wait until both ends of the topics know each other, not only the graph knows both."""
    world.meet(*specs, others=others)
    time.sleep(0.4)


def pour(world, *specs, number: int, period_s: float = 0.002, first: int = 0) -> np.ndarray:
    """Publish messages of `imu` on topics, one each per period; return when [ns]."""
    begin = time.monotonic()
    sent_ns = []
    for i in range(first, first + number):
        sent_ns.append(time.time_ns())
        for spec in specs:
            world.publish(spec, imu(i))
        time.sleep(max(begin + (i - first + 1) * period_s - time.monotonic(), 0))
    return np.array(sent_ns)


def metrics(report) -> dict[str, str]:
    return {pair.key: pair.value for s in report.status for pair in s.values}


def recorded(world, number: int) -> None:
    """Wait until the recorder counts this number of messages, without its own reports.

    All its reports must have been heard.
    """
    end = time.monotonic() + 60.0
    while True:
        world.hear()
        reports = (metrics(r) for r in world.heard[DIAGNOSTICS.name])
        counts = (int(report["messages"]) for report in reports if "messages" in report)
        if any(messages - before >= number for before, messages in enumerate(counts)):
            return
        assert time.monotonic() < end, f"never {number} messages"
        time.sleep(0.01)


def notes(path: Path) -> dict[str, str]:
    return dict(Bag(path).metadata[RECORDER_METADATA])


def test_everything_arrives_unchanged_and_three_libraries_read_it(start, world, tmp_path):
    event = message_class(COLLISION_EVENT.typename)()
    event.header.stamp = to_time(5)
    world.publish(COLLISION_EVENT, event)  # latched, before the recorder is there
    named = ["-p", "topics:=['/steady', '/collision_event']"]
    recorder = record(start, tmp_path / "bag", *named)
    recorder_of_all = record(start, tmp_path / "all", "-p", "all:=true", "-p", "topics:=['']")
    world.subscribe(DIAGNOSTICS)
    meet(world, STEADY, COLLISION_EVENT, others=2)
    meet(world, IMU, others=1)
    pour(world, STEADY, IMU, number=500)

    report = world.wait_for(DIAGNOSTICS, lambda m: metrics(m).get("messages", "0") != "0")
    assert {"lost", "rate_hz", "bytes", "file"} <= metrics(report).keys()
    os.killpg(recorder.process.pid, signal.SIGINT)
    time.sleep(0.02)
    assert recorder.end(signal.SIGINT) == 0
    assert recorder_of_all.end(signal.SIGTERM) == 0

    folder = tmp_path / "bag"
    (path,) = folder.glob("*.mcap")
    with AnyReader([folder]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {"/steady": 500, "/collision_event": 1}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    read = decoded(path, "/steady")
    assert [values.angular_velocity.x for _, values in read] == [float(i) for i in range(500)]
    assert [values.header.stamp.nanosec for _, values in read] == [i * MS for i in range(500)]
    delays = np.array([message.log_time - message.publish_time for message, _ in read])
    assert (delays >= 0).all() and np.median(delays) < 100 * MS
    for raw in Bag(path, check=True).messages(["/steady"])["/steady"].messages:
        x = deserialize_message(raw, message_class(IMU.typename)).angular_velocity.x
        assert x == imu(int(x)).angular_velocity.x
    entries = notes(path)
    assert entries["lost"] == entries["lost:/steady"] == "0"
    assert int(entries["stopped_ns"]) > int(entries["started_ns"])
    assert int(entries["messages"]) == sum(counts.values())
    assert f"recorded {sum(counts.values())} messages" in recorder.output

    with AnyReader([tmp_path / "all"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts["/steady"] == 500 and counts["/collision_event"] == 1
        assert {"/imu/data_raw", "/rosout", "/parameter_events", "/diagnostics"} <= counts.keys()


def test_after_kill_9_all_but_the_last_second_is_there(start, world, tmp_path):
    named = ["-p", "topics:=['/steady']"]
    recorder = record(start, tmp_path / "bag", *named)
    single = f"output:={tmp_path / 'q.mcap'}"
    quiet = start(RECORDER, "-p", single, "-p", "use_sim_time:=true", *named)
    meet(world, STEADY, others=2)
    sent_ns = pour(world, STEADY, number=1500, period_s=0.001)
    killed_ns = time.time_ns()
    recorder.process.kill()
    recorder.process.wait()
    path = tmp_path / "bag" / "bag_0.mcap"
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    bag = Bag(path)
    assert "not closed" in bag.damage[0] or "cut off" in bag.damage[0]
    table = Recording(bag.path).columns("/steady")
    old = int(np.searchsorted(sent_ns, killed_ns - 1_000_000_000))
    assert len(table["log_time_ns"]) >= old > 10
    x = table["angular_velocity.x"]
    np.testing.assert_array_equal(x, np.arange(len(x)))

    time.sleep(0.7)  # nothing comes any more, and still what came is written
    quiet.process.kill()
    quiet.process.wait()
    bag = Bag(tmp_path / "q.mcap")
    assert bag.topics["/steady"].count == 1500


def test_losses_are_counted_and_said(start, world, tmp_path, monkeypatch):
    """A recorder that stands still for longer than its sockets can keep messages loses some."""
    small = tmp_path / "small_sockets.xml"
    small.write_text(Path(os.environ[PROFILES]).read_text().replace("4194304", "65536"))
    monkeypatch.setenv(PROFILES, str(small))
    world.subscribe(DIAGNOSTICS)
    recorder = start(RECORDER, "-p", f"output:={tmp_path / 'a.mcap'}")
    meet(world, IMU, ODOMETRY)
    pour(world, IMU, number=10)
    recorded(world, 10)
    recorder.process.send_signal(signal.SIGSTOP)
    pour(world, IMU, number=3000, period_s=0.0003, first=10)
    recorder.process.send_signal(signal.SIGCONT)
    recorded(world, 11)  # it goes on
    pour(world, IMU, number=10, first=3010)
    time.sleep(0.6)
    assert recorder.end() == 0
    received = Bag(tmp_path / "a.mcap").topics["/imu/data_raw"].count
    lost = int(notes(tmp_path / "a.mcap")["lost:/imu/data_raw"])
    assert lost > 100 and received + lost == 3020
    assert f"lost {lost}" in recorder.output


def test_other_qos_several_publishers_and_types_nobody_can_describe(start, world, tmp_path):
    from rcl_interfaces.srv import ListParameters

    strange = world.node.create_publisher(ListParameters.Event, "/strange", 10)
    weak = TopicSpec(ODOMETRY.name, ODOMETRY.typename, SENSOR, 0.0, "best effort")
    goals = TopicSpec("/goals", "nav_msgs/msg/Goals", Qos(), 0.0, "not of rosbags' store")
    world.subscribe(DIAGNOSTICS)
    recorder = record(start, tmp_path / "bag", "-p", "all:=true")
    text = world.wait_for_fault("recorder", "undescribed./strange")
    assert "ListParameters_Event" in text and "accepted" not in text
    meet(world, weak)
    meet(world, goals, IMU)
    second = world.node.create_publisher(
        message_class(IMU.typename), IMU.name, rclpy.qos.qos_profile_sensor_data
    )
    world.wait_for(DIAGNOSTICS, lambda m: IMU.name in metrics(m).get("crowded", ""))
    for i in range(50):
        world.publish(weak, message_class(weak.typename)())
        world.publish(IMU, imu(i))
        second.publish(imu(i))
        if i > 20:
            second.publish(imu(i))
        time.sleep(0.01)
    world.publish(goals, message_class(goals.typename)())
    strange.publish(ListParameters.Event())
    time.sleep(0.3)
    assert recorder.end() == 0
    path = tmp_path / "bag" / "bag_0.mcap"
    with AnyReader([tmp_path / "bag"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/odometry"] == 50, "recorder and best-effort publisher agree on best effort"
    assert counts["/imu/data_raw"] == 129
    assert counts["/goals"] == 1
    assert "/strange" not in counts
    entries = notes(path)
    assert "/imu/data_raw" in entries["crowded"].split() and entries["lost:/imu/data_raw"] == "0"
    assert "/odometry" not in entries["crowded"].split()
    assert entries["undescribed:/strange"] == "rcl_interfaces/srv/ListParameters_Event"


def test_a_disk_that_fills_up_ends_the_recording_and_what_was_written_is_read(
    start, world, tmp_path
):
    recorder = record(start, tmp_path / "bag")
    world.subscribe(DIAGNOSTICS)
    meet(world, IMU)
    path = tmp_path / "bag" / "bag_0.mcap"
    pour(world, IMU, number=1000)
    limit = path.stat().st_size + 10_000
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (limit, limit))

    def fill() -> None:
        pour(world, IMU, number=10)

    report = world.wait_for_fault("recorder", "disk", meanwhile=fill)
    assert recorder.process.wait(60) == 1
    assert "can't write" in report and "File too large" in report
    assert "could not be written" in recorder.output and "Traceback" not in recorder.output
    with Recording(tmp_path / "bag") as recording:
        x = recording.columns(IMU.name)["angular_velocity.x"]
        np.testing.assert_array_equal(x[:1000], np.arange(1000))
        assert recording.damage == [] or not (tmp_path / "bag" / "metadata.yaml").exists()


def test_bad_parameters_end_it_with_one_line(start, tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "file").touch()
    cases = {
        "is there already": ["-p", f"output:={tmp_path / 'old'}"],
        "Not a directory": ["-p", f"output:={tmp_path / 'file' / 'bag'}"],
        "accepted: names of topics": ["-p", "output:=c", "-p", "topics:=['/a b']"],
    }
    recorders = {text: start(RECORDER, *arguments) for text, arguments in cases.items()}
    for text, recorder in recorders.items():
        assert recorder.process.wait(60) == 2
        (line,) = recorder.output.splitlines()
        assert line.startswith("Error: ") and text in line
    assert sorted(p.name for p in tmp_path.iterdir() if p.suffix != ".log") == ["file", "old"]
