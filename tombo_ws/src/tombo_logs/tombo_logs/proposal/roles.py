"""Which columns could hold which channel, by the words in their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from tombo_logs.proposal.column_names import ColumnGroup

_MOCAP = {"vicon", "mocap", "optitrack", "motive", "qualisys", "qtm", "vrpn", "lighthouse",
          "visual", "pose", "srv"}  # fmt: skip
_ESTIMATE = {
    "est",
    "local",
    "estimate",
    "estimated",
    "estimator",
    "kalman",
    "ekf",
    "state",
    "filtered",
}
_ASKED = {"sp", "setpoint", "target", "ctrltarget", "ref", "reference", "desired", "des", "goal",
          "controller", "pid", "cmd"}  # fmt: skip
_SPREAD = {"b", "bias", "cov", "covariance", "var", "variance", "std", "stddev", "noise", "err",
           "error", "delta", "innovation", "reset"}  # fmt: skip
_POSITION = {"p", "pos", "position", "translation", "location", "t", "xyz"}
_GYRO = {"gyro", "gyr", "gyroscope"}
_RATES = {"w", "g", "omega", "angular", "rates", "rate", "angvel"}
_ACCEL = {"acc", "accel", "accelerometer", "acceleration", "a"}
_OTHERS = {"v", "vel", "velocity", "speed", "twist", "mag", "magnetometer", "m", "force", "torque",
           "moment", "wind", "linear", "baro", "g"}  # fmt: skip
_LOAD = {"payload", "load", "cable", "pendulum", "sling"}
"""What hangs from the vehicle."""
_QUATERNION = {"q", "quat", "quaternion", "orientation", "attitude", "rotation"}
_SPEED = {"rpm", "erpm", "omega", "speed", "velocity", "w"}
_MOTOR = {"motor", "motors", "m", "pwm", "output", "outputs", "control", "controls", "actuator",
          "actuators", "esc", "rotor", "rotors", "servo", "throttle", "cmd", "command", "u",
          "channels"}  # fmt: skip
_COMMAND = {"motor", "motors", "command", "cmd", "control", "controls", "throttle", "normalized"}
_TRUTH = {"truth", "groundtruth", "gt"}


@dataclass(frozen=True)
class Candidate:
    """Columns that could hold a channel."""

    columns: tuple[str, ...]
    group: ColumnGroup
    score: float

    @property
    def text(self) -> str:
        """The columns, in short."""
        return f"{self.columns[0]} …" if len(self.columns) > 1 else self.columns[0]


def _ranked(candidates: Iterable[Candidate]) -> list[Candidate]:
    return sorted(candidates, key=lambda c: -c.score)


def _bonus(group: ColumnGroup, likes: Mapping[str, float]) -> float:
    sets = {"mocap": _MOCAP, "estimate": _ESTIMATE, "truth": _TRUTH}
    return sum(value for name, value in likes.items() if sets[name] & set(group.words))


def _vector(group: ColumnGroup) -> tuple[str, ...] | None:
    """Return the columns of a vector, by axes or as three numbered elements."""
    if {"x", "y", "z"} <= set(group.by_axis) and "w" not in group.by_axis:
        return tuple(group.by_axis[a] for a in "xyz")
    if set(group.by_number) == {0, 1, 2}:
        return tuple(group.by_number[i] for i in range(3))
    return None


def positions(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return what could be positions, best first."""
    refused = _ASKED | _SPREAD | _GYRO | _RATES | _ACCEL | _OTHERS | _LOAD
    names = {group.words for group in groups if _vector(group) is not None}
    return _ranked(
        Candidate(columns, group, 3.0 * (_says_position(group) and not beside) + likes)
        for group in groups
        for beside in [group.words[-1:] == ("p",) and group.words[:-1] in names]
        if not refused & set(group.words) and group.unit in ("", "m", "cm", "mm")
        for columns in [_vector(group)]
        if columns is not None and (group.by_axis or _says_position(group))
        # X.px beside X.x is the place of something else: of a payload, in a Crazyflie's log
        for likes in [
            _bonus(group, {"mocap": 3.0, "estimate": -2.0, "truth": -1.0}) - 2.0 * beside
        ]
    )


def _says_position(group: ColumnGroup) -> bool:
    return bool(_POSITION & set(group.words))


def rates(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return what could be a gyro, best first."""
    return _vectors(groups, _GYRO, _RATES, _ACCEL | {"mag"})


def accels(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return what could be an accelerometer, best first."""
    return _vectors(groups, _ACCEL - {"a"}, {"a"}, _GYRO | {"angular"})


def _vectors(
    groups: Sequence[ColumnGroup], sure: set[str], likely: set[str], refused: set[str]
) -> list[Candidate]:
    likes = {"mocap": -4.0, "estimate": -2.0}
    return _ranked(
        Candidate(columns, g, 4.0 * bool(sure & set(g.words)) + g.has("imu") + _bonus(g, likes))
        for g in groups
        if (sure | likely) & set(g.words) and not (refused | _ASKED | _SPREAD) & set(g.words)
        for columns in [_vector(g)]
        if columns is not None
    )


def quaternions(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return what could be quaternions, best first: as x, y, z, w, or as four numbers."""
    candidates = []
    for group in groups:
        if (_ASKED | _SPREAD | _LOAD) & set(group.words):
            continue
        likes = _bonus(group, {"mocap": 2.0, "estimate": -2.0, "truth": -1.0})
        if {"w", "x", "y", "z"} <= set(group.by_axis):
            columns = tuple(group.by_axis[a] for a in "xyzw")
            candidates.append(Candidate(columns, group, 3.0 + likes))
        elif set(group.by_number) == {0, 1, 2, 3} and _QUATERNION & set(group.words):
            columns = tuple(group.by_number[i] for i in range(4))
            candidates.append(Candidate(columns, group, 2.0 + likes))
    return _ranked(candidates)


def angles(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return what could be roll, pitch and yaw, best first; fewer than three where some lack."""
    refused = _ASKED | _SPREAD | _GYRO | _RATES | _LOAD
    return _ranked(
        Candidate(columns, group, 10.0 * len(columns) + likes)
        for group in groups
        if not refused & set(group.words)
        for columns in [tuple(group.by_axis[a] for a in ("roll", "pitch", "yaw")
                              if a in group.by_axis)]
        if columns
        for likes in [_bonus(group, {"mocap": 2.0, "estimate": -2.0})]
    )  # fmt: skip


def rotors(groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return columns of four rotors or more, best first, from the lowest number."""
    candidates = []
    for group in groups:
        numbers = sorted(group.by_number)
        first = numbers[0] if numbers else -1
        if first not in (0, 1) or numbers[:4] != list(range(first, first + 4)):
            continue
        words = set(group.words)
        if not words & (_MOTOR | _SPEED) or words & (_QUATERNION | _ACCEL | _GYRO | _SPREAD):
            continue
        columns = tuple(group.by_number[i] for i in numbers[:4])
        candidates.append(Candidate(columns, group, float(bool(words & _COMMAND))))
    return _ranked(candidates)


def is_speed(group: ColumnGroup) -> bool:
    """Return whether the name of rotors' columns says that they are speeds."""
    return group.unit in ("rpm", "rad/s") or bool(_SPEED & set(group.words))


Find: TypeAlias = Callable[[Sequence[ColumnGroup]], list[str]]


def is_estimate(group: ColumnGroup) -> bool:
    """Return whether a name says that a vehicle has estimated it."""
    return bool(_ESTIMATE & set(group.words)) and not _MOCAP & set(group.words)


def _single(accepted: set[str], endings: tuple[str, ...]) -> Find:
    def find(groups: Sequence[ColumnGroup]) -> list[str]:
        return [
            next(iter(g.by_number.values()))
            for g in groups
            if set(g.by_number) == {-1}
            and g.words
            and (accepted & set(g.words) or g.words[-1].endswith(endings))
            and not (_ASKED | _SPREAD) & set(g.words)
        ]

    return find


voltages = _single({"vbat", "vbatt", "voltage", "volt", "volts", "battery", "bat"}, ("voltage",))
currents = _single({"current", "amps", "ibat"}, ("current",))
times = _single({"t", "time", "timestamp", "stamp", "secs", "seconds", "ts"}, ("time", "stamp"))
