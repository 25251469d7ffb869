"""Logs as a laboratory's own tools write them: a table with a mapping, or a ROS 2 bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tombo_benchmarks.diagnosis.second_simulator.sensors import Stream
from tombo_benchmarks.diagnosis.second_simulator.vehicles import GRAVITY, Array, Quadrotor

FORMATS = ("table", "turned_table", "bag")
"""table: east, north, up and SI with few exceptions; turned_table: north, east, down, body
forward, right, down, and the units of a flight controller; bag: MCAP of ROS 2."""
_PADDED = {
    "pose": ("opti_us", "opti_rx_us", "tx", "ty", "tz", "rw", "rx", "ry", "rz"),
    "imu": ("fc_us", "p", "q", "r", "sfx", "sfy", "sfz"),
    "speed": ("esc_us", "m1", "m2", "m3", "m4"),
    "command": ("mix_us", "u1", "u2", "u3", "u4"),
    "throttle": ("pwm_us", "t1", "t2", "t3", "t4"),
    "supply": ("bat_us", "vbat", "ibat"),
}
"""Columns of the tables; motors in the order of `vehicles.ROTORS`."""
_OUR_ORDER = (1, 2, 3, 0)
"""Front right, rear left, front left, rear right in that order."""
_TOP_THROTTLE = 65535.0
_EPOCH_S = 1754.25
"""Of the logger's clock at the start of a log."""
_TO_DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_TO_RIGHT = np.array([1.0, -1.0, -1.0])

_ACTUATORS = "actuator_msgs/msg/Actuators"
_ACTUATORS_FIELDS = (
    "std_msgs/Header header\nfloat64[] position\nfloat64[] velocity\nfloat64[] normalized\n"
)


def write_table(path: Path, streams: Mapping[str, Stream], turned: bool) -> None:
    """Write a CSV with the streams side by side; short ones end in empty cells."""
    names: list[str] = []
    columns: list[list[str]] = []
    for key, stream in streams.items():
        names += _PADDED[key]
        times = [stream.t] if stream.arrival is None else [stream.t, stream.arrival]
        for t in times:
            columns.append([f"{1e6 * (x + _EPOCH_S):.0f}" for x in t.tolist()])
        values = _in_file_units(key, stream.values, turned)
        for column in values.T.tolist():
            columns.append([f"{x:.7g}" for x in column])
    longest = max(map(len, columns))
    padded = [c + [""] * (longest - len(c)) for c in columns]
    lines = [",".join(names), *map(",".join, zip(*padded, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _in_file_units(key: str, values: Array, turned: bool) -> Array:
    """Return values in the units and axes of the table."""
    if key in ("speed", "command"):
        return np.asarray(np.round(values * 30.0 / np.pi))
    if key == "throttle":
        return np.asarray(np.round(values * _TOP_THROTTLE))
    if key == "supply":
        return values * (1000.0, 1.0)
    if not turned:
        return values * ((1000.0,) * 3 + (1.0,) * 4) if key == "pose" else values
    if key == "imu":
        body = np.hstack([values[:, :3] * _TO_RIGHT, values[:, 3:] * _TO_RIGHT])
        return np.asarray(body * np.repeat([180.0 / np.pi, 1.0 / GRAVITY], 3))
    # A quaternion from forward-left-up into east-north-up, in the turned axes of both: the half
    # turn about x of the body on the right, the exchange of axes of the world on the left.
    w, x, y, z = values[:, 3:].T
    r = np.sqrt(0.5)
    q = r * np.column_stack([w + z, x + y, x - y, w - z])
    return np.hstack([values[:, :3] @ _TO_DOWN.T, q])


def mapping_text(streams: Mapping[str, Stream], turned: bool, airframe: Quadrotor | None) -> str:
    """Return the mapping file of the tables, as a user writes it after docs/logs.md."""
    length, rate, force = ("m", "deg/s", "g") if turned else ("mm", "rad/s", "m/s^2")
    lines = ["about: second simulator"]
    if turned:
        lines += ["world: NED", "body: FRD"]
    lines.append("channels:")

    def channel(name: str, key: str, columns: tuple[str, ...], extra: str) -> None:
        stamp = f"time: {{column: {_PADDED[key][0]}, unit: us}}"
        if key == "pose":
            stamp += f", arrival: {{column: {_PADDED[key][1]}, unit: us}}"
        lines.append(f"  {name}: {{columns: [{', '.join(columns)}], {extra}, {stamp}}}")

    channel("position", "pose", _PADDED["pose"][2:5], f"unit: {length}")
    channel("attitude", "pose", _PADDED["pose"][5:], "order: wxyz")
    if "imu" in streams:
        channel("gyro", "imu", _PADDED["imu"][1:4], f"unit: {rate}")
        channel("accel", "imu", _PADDED["imu"][4:], f"unit: {force}")
    for name, key in (("rotor_speed", "speed"), ("rotor_command", "command")):
        if key in streams:
            motors = _PADDED[key][1:]
            channel(name, key, tuple(motors[k] for k in _OUR_ORDER), "unit: rpm")
    if "throttle" in streams:
        motors = _PADDED["throttle"][1:]
        scale = f"range: [0, {_TOP_THROTTLE:.0f}]"
        channel("motor_command", "throttle", tuple(motors[k] for k in _OUR_ORDER), scale)
    channel("voltage", "supply", ("vbat",), "unit: mV")
    channel("current", "supply", ("ibat",), "unit: A")
    if airframe is not None:
        lines.append(
            f"airframe: {{name: {airframe.name}, mass: {airframe.mass}, "
            f"arm_length: {airframe.arm}, rotor_radius: {airframe.rotor_radius}, "
            f"inertia: {list(airframe.inertia)}, motor_time_constant: {airframe.lag}}}"
        )
    return "\n".join(lines) + "\n"


def vehicle_text(quad: Quadrotor) -> str:
    """Return the vehicle file of a vehicle that is not the suite's, as measured on a bench.

    Its thrust must grow with the square of the speed.
    """
    speed, thrust, torque = quad.thrust_table[-1]
    k_thrust = thrust / speed**2
    least, most = (k_thrust * n**2 for n in quad.speeds)

    def noted(value: float, share: float) -> str:
        return f"{{value: {value:.6g}, tolerance: {share * value:.6g}}}"

    inertia = (
        f"  inertia_{a}{a}: {noted(i, 0.05)}" for a, i in zip("xyz", quad.inertia, strict=True)
    )
    return "\n".join([
        "tombo_vehicle: 1", f"name: {quad.name}", "vehicle:",
        f"  mass: {noted(quad.mass, 0.01)}", *inertia, f"  arm_length: {quad.arm}",
        f"  rotor_height: {quad.rotor_height}", f"  rotor_inertia: {quad.rotor_inertia}",
        f"  motor_time_constant: {quad.lag}", f"  rotor_speed_min: {quad.speeds[0]}",
        f"  rotor_speed_max: {quad.speeds[1]}", f"  battery_voltage: {quad.battery}",
        "propeller:", f"  k_thrust: {noted(k_thrust, 0.02)}",
        f"  k_torque: {torque / speed**2:.6g}", f"  radius: {quad.rotor_radius}",
        "  on_impact: rigid", "  matched: 0.01",
        "drive:", f"  gain: {noted(most - least, 0.02)}", f"  offset: {least:.6g}",
        "  supply_exponent: 2", f"  supply: {quad.battery}",
    ]) + "\n"  # fmt: skip


def write_bag(path: Path, streams: Mapping[str, Stream], speed_definition: str) -> None:
    """Write a rosbag2 folder with an MCAP, in the order of arrival.

    Args:
        path: of the folder.
        streams: of one flight.
        speed_definition: text of tombo_msgs/RotorSpeeds, for which ROS has no standard message.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    speeds = "tombo_msgs/msg/RotorSpeeds"
    store.register(get_types_from_msg(speed_definition, speeds))
    store.register(get_types_from_msg(_ACTUATORS_FIELDS, _ACTUATORS))
    known = store.types
    header, time = known["std_msgs/msg/Header"], known["builtin_interfaces/msg/Time"]
    vector, rotation = (known[f"geometry_msgs/msg/{n}"] for n in ("Vector3", "Quaternion"))
    point, pose = (known[f"geometry_msgs/msg/{n}"] for n in ("Point", "Pose"))
    none = np.zeros(9)

    def pose_message(head: Any, v: list[float]) -> Any:
        there = pose(point(*v[:3]), rotation(*v[4:7], v[3]))
        return known["geometry_msgs/msg/PoseStamped"](head, there)

    def imu_message(head: Any, v: list[float]) -> Any:
        unit = rotation(0.0, 0.0, 0.0, 1.0)
        return known["sensor_msgs/msg/Imu"](
            head, unit, -1.0 + none, vector(*v[:3]), none, vector(*v[3:]), none
        )

    def speed_message(head: Any, v: list[float]) -> Any:
        return known[speeds](head, np.array([v[k] for k in _OUR_ORDER]))

    def throttle_message(head: Any, v: list[float]) -> Any:
        none_asked = np.zeros(0)
        asked = np.array([v[k] for k in _OUR_ORDER])
        return known[_ACTUATORS](head, none_asked, none_asked, asked)

    def supply_message(head: Any, v: list[float]) -> Any:
        nan, empty = float("nan"), np.zeros(0, np.float32)
        return known["sensor_msgs/msg/BatteryState"](
            head, v[0], nan, -v[1], nan, nan, nan, nan, 0, 0, 0, True, empty, empty, "", ""
        )

    kinds = {
        "pose": ("/mocap/pose", "geometry_msgs/msg/PoseStamped", "map", pose_message),
        "imu": ("/imu/data_raw", "sensor_msgs/msg/Imu", "base_link", imu_message),
        "speed": ("/rotor_speed", speeds, "base_link", speed_message),
        "command": ("/rotor_command", speeds, "base_link", speed_message),
        "throttle": ("/actuators", _ACTUATORS, "base_link", throttle_message),
        "supply": ("/battery", "sensor_msgs/msg/BatteryState", "", supply_message),
    }
    zero = 1_700_000_000 * 10**9
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        queue = []
        for key, stream in streams.items():
            topic, typename, frame, make = kinds[key]
            link = writer.add_connection(topic, typename, typestore=store)
            arrival = stream.t if stream.arrival is None else stream.arrival
            for t, a, v in zip(
                stream.t.tolist(), arrival.tolist(), stream.values.tolist(), strict=True
            ):
                stamp = zero + round(t * 1e9)
                head = header(time(stamp // 10**9, stamp % 10**9), frame)
                raw = store.serialize_cdr(make(head, v), typename)
                queue.append((zero + round(a * 1e9), link, raw))
        for when, link, raw in sorted(queue, key=lambda each: each[0]):
            writer.write(link, when, raw)
