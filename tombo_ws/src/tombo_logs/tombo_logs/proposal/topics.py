"""A mapping for a recording: topics of other names and types than those read without one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tombo_bag.columns import number_columns
from tombo_bag.flight import Series
from tombo_bag.recording import Recording
from tombo_bag.topics import BATTERY, IMU, MOCAP_POSE, POSE_TYPES
from tombo_dynamics.arrays import Array
from tombo_logs.checks.rotors.rotor_order import clear_order
from tombo_logs.proposal import roles
from tombo_logs.proposal.column_names import grouped
from tombo_logs.proposal.propose import Line, Proposal
from tombo_logs.proposal.value_evidence import accel_unit, motor_scale, speed_unit
from tombo_logs.readers.bag_log import usable_topics

_ARRAYS = tuple(
    f"std_msgs/msg/{kind}MultiArray" for kind in ("Float32", "Float64", "Int32", "UInt16")
)
_MOCAP = ("mocap", "vicon", "vrpn", "optitrack", "qualisys", "natnet", "pose")


def propose_topics(recording: Recording, known: set[str]) -> Proposal:
    """Propose topics for the channels that are not `known`, each with its reason."""
    proposal = Proposal()
    if not {"position", "attitude"} <= known:
        _poses(recording, proposal)
    if "gyro" not in known:
        _imu(recording, proposal)
    if "voltage" not in known:
        for topic in usable_topics(recording, (BATTERY.typename,))[:1]:
            content = {"topic": topic, "columns": ["voltage"], "unit": "V"}
            proposal.channels.append(Line("voltage", content, f"{topic} is a {BATTERY.typename}"))
    _arrays(recording, proposal, known)
    return proposal


def _poses(recording: Recording, proposal: Proposal) -> None:
    topics = usable_topics(recording, POSE_TYPES)
    if not topics:
        proposal.notes.append(f"no topic with poses; needed is one of {', '.join(POSE_TYPES)}")
        return
    topics.sort(key=lambda topic: -sum(word in topic.lower() for word in _MOCAP))
    topic, *others = topics
    typename = recording.topics[topic].typename
    why = f"{topic} is a {typename}, which is read by itself as {MOCAP_POSE.name}"
    doubt = f"poses are also in {', '.join(others)}" if others else ""
    if typename == "nav_msgs/msg/Odometry":
        doubt = "; ".join(filter(None, (doubt, "odometry may be an estimate, not motion capture")))
    place, turn = POSE_TYPES[typename]
    columns = {"position": [f"{place}.{x}" for x in "xyz"]}
    columns["attitude"] = [f"{turn}.{x}" for x in "xyzw"]
    for key, names in columns.items():
        content: dict[str, object] = {"topic": topic, "columns": names}
        content |= {"unit": "m"} if key == "position" else {"order": "xyzw"}
        proposal.channels.append(Line(key, content, why, doubt))


def _imu(recording: Recording, proposal: Proposal) -> None:
    topics = usable_topics(recording, (IMU.typename,))
    topics.sort(key=lambda topic: "raw" not in topic)
    if not topics:
        return
    topic, *others = topics
    table = recording.columns(topic)
    accel = np.column_stack([table[f"linear_acceleration.{x}"] for x in "xyz"])
    guess = accel_unit(accel, "m/s^2")
    why = f"{topic} is a {IMU.typename}, which is read by itself as {IMU.name}"
    doubt = f"so is {', '.join(others)}" if others else ""
    for key, field, unit in (("gyro", "angular_velocity", "rad/s"),
                             ("accel", "linear_acceleration", guess and guess.unit)):  # fmt: skip
        if unit is None:
            proposal.notes.append(f"{topic}: gravity is not in its acceleration")
            continue
        content = {"topic": topic, "columns": [f"{field}.{x}" for x in "xyz"], "unit": unit}
        proposal.channels.append(Line(key, content, why, doubt))


def _arrays(recording: Recording, proposal: Proposal, known: set[str]) -> None:
    """Propose arrays of four numbers or more whose topics are named as rotors are."""
    for topic in usable_topics(recording, _ARRAYS):
        table = dict(number_columns(recording.columns(topic)))
        columns = {f"{topic}.{name}": values for name, values in table.items() if "data[" in name}
        for candidate in roles.rotors(grouped(columns)):
            values = np.column_stack([columns[name] for name in candidate.columns])
            key, more, doubt = _scale(candidate, values)
            if not more or key in known:
                continue
            names = [name.rpartition(".")[2] for name in candidate.columns]
            why = f"{topic}: named as rotors are; values up to {np.nanmax(values):.4g}"
            content = {"topic": topic, "columns": names, **more}
            doubt = "; ".join(filter(None, (doubt, "the order is taken as PX4's quad-X")))
            proposal.channels.append(Line(key, content, why, doubt))
            break


def _scale(candidate: roles.Candidate, values: Array) -> tuple[str, dict[str, object], str]:
    if roles.is_speed(candidate.group):
        guess = speed_unit(values, candidate.group.unit, candidate.group.words)
        return "rotor_speed", {"unit": guess.unit}, guess.doubt
    scale = motor_scale(values)
    return "motor_command", {} if scale is None else {"range": list(scale)}, ""


def reordered(line: Line, drive: Series, gyro: Series) -> Line:
    """Return a line with its columns in the order that the motion tells, where it does."""
    order = clear_order(drive, gyro)
    columns = line.content["columns"]
    assert isinstance(columns, Sequence)
    if order is None:
        return line
    content: Mapping[str, object] = {**line.content, "columns": [columns[i] for i in order]}
    return Line(line.key, content, f"{line.why}; order as the motion says")
