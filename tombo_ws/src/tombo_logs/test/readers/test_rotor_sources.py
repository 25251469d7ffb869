"""Commands and speeds of rotors from the messages in which labs have them."""

import numpy as np
import pytest
from foreign_bags import pose, write_foreign
from log_writers import close, microseconds, px4_poses, write_ulog
from made_flight import made_flight

from tombo_dynamics.errors import InputError
from tombo_logs.readers.bag_log import read_bag
from tombo_logs.readers.csv_mapping import parse_mapping
from tombo_logs.readers.ulog import read_ulog

FLIGHT = made_flight(duration=3.0, mocap_hz=50.0, imu_hz=100.0)
SPEED = FLIGHT.series["rotor_speed"]
RPM = np.abs(SPEED.values) * 30.0 / np.pi
SHARE = np.clip(SPEED.values / 800.0, 0.0, 1.0)


def items(name, i, **more):
    return {name: [{"rpm": round(x), **more} for x in RPM[i]]}


STREAMS = {
    "actuator_msgs": ("/x3/command/motor_speed", "actuator_msgs/msg/Actuators", "rotor_command",
                      lambda i: {"velocity": SPEED.values[i]}),
    "rotors asked": ("/iris/command/motor_speed", "mav_msgs/msg/Actuators", "rotor_command",
                     lambda i: {"angular_velocities": SPEED.values[i]}),
    "rotors measured": ("/iris/motor_speed", "mav_msgs/msg/Actuators", "rotor_speed",
                        lambda i: {"angular_velocities": SPEED.values[i]}),
    "mavros": ("/mavros/esc_status/status", "mavros_msgs/msg/ESCStatus", "rotor_speed",
               lambda i: items("esc_status", i)),
    "ardupilot": ("/mavros/esc_telemetry", "mavros_msgs/msg/ESCTelemetry", "rotor_speed",
                  lambda i: items("esc_telemetry", i, voltage=1500)),
    "pulses": ("/mavros/rc/out", "mavros_msgs/msg/RCOut", "motor_command",
               lambda i: {"channels": np.round(1000.0 + 1000.0 * SHARE[i]).astype(int)}),
}  # fmt: skip


@pytest.mark.parametrize("ros1", [False, True])
@pytest.mark.parametrize("name", STREAMS)
def test_rotors_are_known_by_the_type_of_their_message(tmp_path, name, ros1):
    """The definition is in the file: no package of the lab is installed."""
    topic, typename, channel, fields = STREAMS[name]
    streams = [pose(FLIGHT), (topic, typename, SPEED.t, fields)]
    log = read_bag(write_foreign(tmp_path / "a.bag", streams, ros1), "a")
    expected = SHARE if channel == "motor_command" else np.abs(SPEED.values)
    close(log.series[channel].values, expected, 0.06)  # rounded to rpm, or to 1 us
    # stamped at capture, but for a message without a header
    late = 0.005 if name == "ardupilot" else 0.0
    close(log.series[channel].t - log.series["position"].t[0], SPEED.t + late, 1e-6)
    assert any(topic in f.message and "quad-X" in f.message for f in log.findings)


def test_two_topics_that_could_be_it_are_left_out_and_said(tmp_path):
    _, typename, channel, fields = STREAMS["mavros"]
    streams = [pose(FLIGHT), *((t, typename, SPEED.t, fields) for t in ("/a/esc", "/b/esc"))]
    log = read_bag(write_foreign(tmp_path / "a", streams), "a")
    assert channel not in log.series
    assert any("/a/esc and /b/esc could be it" in f.message for f in log.findings)


def px4_streams():
    """Poses, commands and speeds as PX4 sends them: NED and FRD, its own clock in us."""
    p = FLIGHT.series["position"]
    place, turn = px4_poses(FLIGHT)

    def posed(i):
        us = round((p.t[i] + 7.0) * 1e6)
        return {"timestamp": us + 900, "timestamp_sample": us, "position": place[i], "q": turn[i]}

    def commanded(i):
        us = round((SPEED.t[i] + 7.0) * 1e6)
        return {"timestamp": us + 200, "timestamp_sample": us,
                "control": [*SHARE[i], *[np.nan] * 8]}  # fmt: skip

    def turned(i):
        escs = [{"esc_rpm": round(RPM[i, m]), "actuator_function": 101 + m} for m in (2, 0, 3, 1)]
        return {"timestamp": round((SPEED.t[i] + 7.0) * 1e6), "esc": escs}

    return [
        ("/fmu/in/vehicle_visual_odometry", "px4_msgs/msg/VehicleOdometry", p.t, posed),
        ("/fmu/out/actuator_motors_v1", "px4_msgs/msg/ActuatorMotors", SPEED.t, commanded),
        ("/fmu/out/esc_status", "px4_msgs/msg/EscStatus", SPEED.t, turned),
    ]


def test_topics_of_px4_are_read_as_its_log_is(tmp_path):
    log = read_bag(write_foreign(tmp_path / "a", px4_streams()), "a")
    close(log.series["position"].values, FLIGHT.series["position"].values, 1e-6)
    close(log.series["motor_command"].values, SHARE, 1e-6)
    close(log.series["rotor_speed"].values, np.abs(SPEED.values), 0.06)
    start = log.series["position"].t[0]
    close(log.series["motor_command"].t - start, SPEED.t - FLIGHT.series["position"].t[0], 1e-5)


def test_a_mapping_names_topics_columns_and_order(tmp_path):
    """An array of numbers says nothing of itself; here in rpm, M1 to M4 as Bitcraze has them."""
    bitcraze = RPM[:, [0, 3, 1, 2]]
    row = SPEED.t, lambda i: {"data": bitcraze[i]}
    streams = [pose(FLIGHT, "/vicon/drone"), ("/rpm", "std_msgs/msg/Float32MultiArray", *row)]
    path = write_foreign(tmp_path / "a", streams)
    text = """
channels:
  position:
    topic: /vicon/drone
    columns: [pose.position.x, pose.position.y, pose.position.z]
    unit: m
  attitude:
    topic: /vicon/drone
    columns: [pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w]
  rotor_speed: {topic: /rpm, columns: ["data[0]", "data[2]", "data[3]", "data[1]"], unit: rpm}
"""
    log = read_bag(path, "a", mapping=parse_mapping(text, "lab"))
    close(log.series["position"].values, FLIGHT.series["position"].values)
    close(log.series["rotor_speed"].values, np.abs(SPEED.values), 1e-3)
    for old, new, complaint in (
        ("data[3]", "data[9]", r"unknown column of /rpm 'data\[9\]'"),
        ("topic: /rpm", "topic: /rpn", "did you mean '/rpm'"),
        ("topic: /rpm", "topic: /ground_truth/rpm", "must not see"),
    ):
        with pytest.raises(InputError, match=complaint):
            read_bag(path, "a", mapping=parse_mapping(text.replace(old, new), "lab"))


def test_places_of_px4s_motors_are_from_its_parameters(tmp_path):
    """Motors numbered clockwise from front right: `CA_ROTORn_PX` and `_PY` tell."""
    path = tmp_path / "a.ulg"
    out = write_ulog(path, FLIGHT)
    places = {0: (0.2, 0.2), 1: (-0.2, 0.2), 2: (-0.2, -0.2), 3: (0.2, -0.2)}
    for motor, place in places.items():
        for axis, value in zip("XY", place, strict=True):
            key = f"float CA_ROTOR{motor}_P{axis}".encode()
            value_bytes = np.float32(value).tobytes()
            out.definitions += out.message("P", bytes([len(key)]) + key + value_bytes)
    path.write_bytes(out.content())
    command = read_ulog(path, "a").series["motor_command"].values
    # its motors 1, 3, 4, 2 are our front right, rear left, front left, rear right
    written = np.clip(FLIGHT.series["rotor_command"].values / 800.0, 0.0, 1.0)
    close(command, written[:, [0, 2, 3, 1]], 1e-6)


ARMED = np.where(SHARE < 0.05, 0.0, SHARE)
"""Motors stand, then turn."""
PULSES = 1000.0 + 1000.0 * ARMED
DSHOT = np.round(1999.0 * ARMED)
AUX = np.full_like(SHARE, 1500.0)
SERVO = AUX + [0.0, 300.0, 0.0, 0.0] * np.sin(SPEED.t)[:, None]


@pytest.mark.parametrize(
    ("instances", "chosen"),
    [
        ([PULSES], 0), ([AUX, PULSES], 1), ([SERVO, AUX, PULSES], 2), ([DSHOT], 0),
        ([AUX, DSHOT], 1), ([PULSES, np.zeros_like(SHARE)], 0),
    ],
)  # fmt: skip
def test_outputs_of_a_px4_log_are_those_that_move_in_pulses_or_dshot(tmp_path, instances, chosen):
    path = tmp_path / "a.ulg"
    out = write_ulog(path, FLIGHT)
    out.data.clear()
    out.subscriptions, out.definitions, out.ids = b"", b"", 0
    p, q = FLIGHT.series["position"], FLIGHT.series["attitude"].values
    stamps = microseconds(p.t)
    out.topic("vehicle_visual_odometry", ["float x", "float y", "float z", "float[4] q"],
              [*p.values.T, q], stamps)  # fmt: skip
    for instance, outputs in enumerate(instances):
        wide = np.column_stack([outputs, np.zeros((len(SHARE), 12))])
        out.topic(
            "actuator_outputs", ["float[16] output"], [wide], microseconds(SPEED.t), instance
        )
    path.write_bytes(out.content())
    log = read_ulog(path, "a")
    close(log.series["motor_command"].values, ARMED, 1e-3)
    assert [f.numbers for f in log.findings if f.key == "instance"] == [(chosen,)] * (chosen > 0)


@pytest.mark.parametrize("late_s", [-6.0, -0.6, 0.4, 12.0])
def test_px4_topics_of_two_clocks_are_aligned_by_their_times_of_recording(tmp_path, late_s):
    (topic, typename, t, posed), *others = px4_streams()
    us = round(1e6 * late_s)

    def shifted(i):
        row = posed(i)
        return row | {k: row[k] + us for k in ("timestamp", "timestamp_sample")}

    log = read_bag(write_foreign(tmp_path / "a", [(topic, typename, t, shifted), *others]), "a")
    start = log.series["position"].t[0] - FLIGHT.series["position"].t[0]
    close(log.series["motor_command"].t - start, SPEED.t, 0.02)
    said = [f for f in log.findings if f.key == "other clock"]
    assert said and all(abs(abs(f.numbers[0]) - abs(late_s)) < 0.02 for f in said)


def test_a_mapping_names_a_topic_of_a_px4_log(tmp_path):
    path = tmp_path / "a.ulg"
    out = write_ulog(path, FLIGHT)
    out.topic("debug_array", ["float[4] data"], [RPM[:, [3, 2, 1, 0]]], microseconds(SPEED.t))
    path.write_bytes(out.content())
    text = """
channels:
  rotor_speed:
    topic: debug_array
    columns: ["data[3]", "data[2]", "data[1]", "data[0]"]
    unit: rpm
    scale: 0.5
"""
    log = read_ulog(path, "a", parse_mapping(text, "lab"))
    close(log.series["rotor_speed"].values, 0.5 * np.abs(SPEED.values), 1e-3)
    close(log.series["rotor_speed"].t - log.series["gyro"].t[0], SPEED.t + 0.0025, 1e-5)
    with pytest.raises(InputError, match=r"unknown column of .* 'data\[9\]'"):
        read_ulog(path, "a", parse_mapping(text.replace("data[3]", "data[9]"), "lab"))
    with pytest.raises(InputError, match=r"unknown topic in .* 'debug_arry'"):
        read_ulog(path, "a", parse_mapping(text.replace("debug_array", "debug_arry"), "lab"))
