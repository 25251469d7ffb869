"""Bodies that a driver publishes together are topics of their own, with their poses and stamps."""

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tombo_bag.message_codec import fields_of
from tombo_bag.recording import Recording

NAMED = "motion_capture_tracking_interfaces/msg/NamedPoseArray"
RIGID = "mocap4r2_msgs/msg/RigidBodies"
TF = "tf2_msgs/msg/TFMessage"
DEFINITIONS = {
    "motion_capture_tracking_interfaces/msg/NamedPose": "string name\ngeometry_msgs/Pose pose\n",
    NAMED: "std_msgs/Header header\nmotion_capture_tracking_interfaces/NamedPose[] poses\n",
    "mocap4r2_msgs/msg/RigidBody": "string rigid_body_name\nint32[] markers\n"
    "geometry_msgs/Pose pose\n",
    RIGID: "std_msgs/Header header\nuint32 frame_number\nmocap4r2_msgs/RigidBody[] rigidbodies\n",
}
STORE = get_typestore(Stores.ROS2_JAZZY)
for name, text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(text, name))
PLACES = {"drone": [0.1, 0.2, 0.3], "wand": [1.0, 2.0, 3.0]}
CHAIN = {"wand": "map", "drone": "wand"}
"""Body → frame that its transform is in."""
TURN = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]


def message(typename, k, bodies):
    """Return CDR of message k: at k/100 s, drone moves along x by 1 cm a message."""
    t = STORE.types
    stamp = t["builtin_interfaces/msg/Time"](sec=5, nanosec=k * 10_000_000)
    header = t["std_msgs/msg/Header"](stamp=stamp, frame_id="map")
    turn = t["geometry_msgs/msg/Quaternion"](*TURN)
    made = []
    for name in bodies:
        x, y, z = np.add(PLACES[name], [0.01 * k * (name == "drone"), 0.0, 0.0]).tolist()
        if typename == TF:
            moved = t["geometry_msgs/msg/Transform"](t["geometry_msgs/msg/Vector3"](x, y, z), turn)
            above = bodies[name] if bodies is CHAIN else "map"
            own = t["std_msgs/msg/Header"](stamp=stamp, frame_id=above)
            made.append(t["geometry_msgs/msg/TransformStamped"](own, name, moved))
            continue
        pose = t["geometry_msgs/msg/Pose"](t["geometry_msgs/msg/Point"](x, y, z), turn)
        if typename == NAMED:
            made.append(t["motion_capture_tracking_interfaces/msg/NamedPose"](name, pose))
        else:
            none = np.zeros(0, np.int32)
            made.append(t["mocap4r2_msgs/msg/RigidBody"](name, none, pose))
    given = {NAMED: (header, made), RIGID: (header, k, made), TF: (made,)}[typename]
    return bytes(STORE.serialize_cdr(t[typename](*given), typename))


def recorded(path, typename, bodies=lambda k: PLACES, topic="/poses"):
    definition, _ = STORE.generate_msgdef(typename, ros_version=2)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(typename, "ros2msg", definition.encode())
        channel = writer.register_channel(topic, "cdr", schema)
        for k in range(20):
            data = message(typename, k, bodies(k))
            writer.add_message(channel, 6_000_000_000 + k, data, 7_000_000_000 + k)
        writer.finish()
    return path


@pytest.mark.parametrize("typename", [NAMED, RIGID, TF])
def test_each_body_is_a_topic_with_its_poses(tmp_path, typename):
    with Recording(recorded(tmp_path / "a.mcap", typename)) as recording:
        assert set(recording.topics) == {"/poses", "/poses/drone", "/poses/wand"}
        table = recording.columns("/poses/drone")
        fields = fields_of("geometry_msgs/msg/PoseStamped", table)
    k = np.arange(20)
    assert np.array_equal(fields["stamp_ns"], 5_000_000_000 + 10_000_000 * k)
    assert np.array_equal(fields["log_time_ns"], 6_000_000_000 + k)
    assert fields["position"] == pytest.approx(
        np.add(PLACES["drone"], np.outer(0.01 * k, [1, 0, 0]))
    )
    assert fields["attitude"] == pytest.approx(np.tile(TURN, (20, 1)))
    assert set(fields["frame_id"]) == {"map"}


def test_a_body_that_is_lost_at_times_keeps_its_own_poses(tmp_path):
    order = [["drone", "wand"], ["wand"], ["wand", "drone"], []]
    path = recorded(tmp_path / "a.mcap", NAMED, lambda k: order[k % 4])
    with Recording(path, {"/poses/drone": "/mocap/pose"}) as recording:
        table = recording.columns("/mocap/pose")
    seen = np.arange(20)[np.arange(20) % 2 == 0]
    assert table["pose.position.x"] == pytest.approx(0.1 + 0.01 * seen)
    assert np.array_equal(table["log_time_ns"], 6_000_000_000 + seen)


def test_transforms_count_where_nothing_else_has_poses(tmp_path):
    """A driver with poses publishes them as /tf, too."""
    recorded(tmp_path / "a_0.mcap", NAMED)
    recorded(tmp_path / "a_1.mcap", TF, topic="/tf")
    with Recording(tmp_path) as recording:
        assert set(recording.topics) == {"/poses", "/poses/drone", "/poses/wand", "/tf"}


def test_a_body_below_another_frame_is_read_in_map(tmp_path):
    """As of REP-105: the place in map is that of the frame between, and the turned offset."""
    path = recorded(tmp_path / "a.mcap", TF, lambda k: CHAIN, "/tf")
    with Recording(path) as recording:
        assert set(recording.topics) == {"/tf", "/tf/drone"}
        fields = fields_of("geometry_msgs/msg/PoseStamped", recording.columns("/tf/drone"))
    offset = np.add([0.1, 0.2, 0.3], np.outer(0.01 * np.arange(20), [1, 0, 0]))
    turned = np.column_stack([-offset[:, 1], offset[:, 0], offset[:, 2]])  # 90 deg about z
    assert fields["position"] == pytest.approx(PLACES["wand"] + turned)
    assert fields["attitude"] == pytest.approx(np.tile([0.0, 0.0, 1.0, 0.0], (20, 1)))
    assert set(fields["frame_id"]) == {"map"}
