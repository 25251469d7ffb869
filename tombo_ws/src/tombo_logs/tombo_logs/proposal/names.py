"""Which columns could hold which channel: names, axes, numbers and units in the names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

_UNITS: Final = {
    "m": "m", "cm": "cm", "mm": "mm",
    "rad": "rad", "deg": "deg", "degrees": "deg",
    "rad/s": "rad/s", "rad s^-1": "rad/s", "rad_s": "rad/s", "rads": "rad/s", "radps": "rad/s",
    "deg/s": "deg/s", "deg_s": "deg/s", "dps": "deg/s", "degps": "deg/s", "deg s^-1": "deg/s",
    "m/s^2": "m/s^2", "m s^-2": "m/s^2", "m_s2": "m/s^2", "m_s_2": "m/s^2", "mps2": "m/s^2",
    "m/s2": "m/s^2", "g": "g", "mg": "mg",
    "m/s": "m/s", "m s^-1": "m/s", "m_s": "m/s", "mps": "m/s",
    "rpm": "rpm", "v": "V", "mv": "mV", "a": "A", "ma": "mA",
    "s": "s", "sec": "s", "secs": "s", "ms": "ms", "us": "us", "usec": "us", "ns": "ns",
    "%": "%", "pct": "%",
}  # fmt: skip
"""Unit as written, in small letters → unit."""
_ENDINGS: Final = sorted((u for u in _UNITS if re.fullmatch(r"\w+", u)), key=len, reverse=True)
_BRACKETED: Final = re.compile(r"\s*[\[(]([^\[\]()]*[A-Za-z%][^\[\]()]*|)[\])]\s*$")
_ELEMENT: Final = re.compile(r"(\[\d+\]|\.\d+)$")
_WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_ANGLES: Final = {"roll": "roll", "pitch": "pitch", "yaw": "yaw", "heading": "yaw",
                  "phi": "roll", "theta": "pitch", "psi": "yaw"}  # fmt: skip
_STEM_AND_AXIS: Final = re.compile(
    r"(p|q|v|a|w|g|t|m|acc|accel|gyro|gyr|omega|pos|vel|mag|quat|rate|rpy)([wxyz])"
)
_ANGLE_OF: Final = {"x": "roll", "y": "pitch", "z": "yaw"}
"""Axis of a column whose name begins with rpy → angle."""


@dataclass(frozen=True)
class ColumnName:
    """The parts of a column's name."""

    raw: str
    words: tuple[str, ...]
    """In small letters, without axis, number and unit."""
    axis: str = ""
    """w, x, y, z, roll, pitch or yaw."""
    number: int | None = None
    """Of an element or a motor, as written."""
    unit: str = ""


def parsed(raw: str) -> ColumnName:
    """Split a name into its parts: `imu_acc_x`, `a_RS_S_x [m s^-2]`, `esc[0].esc_rpm`."""
    text, unit = raw.strip().lstrip("#").strip(), ""
    bracket = _BRACKETED.search(text)
    if bracket is not None:
        unit = _UNITS.get(bracket[1].strip().lower(), "")
        text = text[: bracket.start()]
    if not unit:
        text, unit = _without_unit(text)
    tokens = [word.lower() for word in _WORD.findall(text)]
    axis = _take_axis(tokens)
    number = next((int(word) for word in reversed(tokens) if word.isdigit()), None)
    words = tuple(word for word in tokens if not word.isdigit())
    return ColumnName(raw, words, axis, number, unit)


def _without_unit(text: str) -> tuple[str, str]:
    """Take a unit off the end, or off from before a number in brackets: `gyro_rad[0]`."""
    element = _ELEMENT.search(text)
    name, number = (text, "") if element is None else (text[: element.start()], element[0])
    for ending in _ENDINGS:
        stem = name[: -len(ending)]
        if name.lower().endswith(ending) and len(stem) > 1 and stem[-1] in "_./ ":
            return stem.rstrip("_./ ") + number, _UNITS[ending]
    return text, ""


def _take_axis(tokens: list[str]) -> str:
    """Remove the axis from the words and return it; `vx` leaves `v`."""
    for i in range(len(tokens) - 1, -1, -1):
        word = tokens[i]
        if word in ("x", "y", "z") or (word == "w" and i > 0) or word in _ANGLES:
            del tokens[i]
            return _ANGLES.get(word, word)
        joined = _STEM_AND_AXIS.fullmatch(word)
        if joined is not None:
            tokens[i] = joined[1]
            return _ANGLE_OF.get(joined[2], "") if joined[1] == "rpy" else joined[2]
    return ""


@dataclass(frozen=True)
class ColumnGroup:
    """Columns whose names differ in axis or number alone."""

    words: tuple[str, ...]
    unit: str
    by_axis: dict[str, str]
    """Axis → column."""
    by_number: dict[int, str]
    """Number → column, of those without an axis; -1: no number."""


def grouped(names: Iterable[str]) -> list[ColumnGroup]:
    """Group columns that differ in axis or number only, in order of appearance."""
    groups: dict[tuple[object, ...], ColumnGroup] = {}
    for raw in names:
        name = parsed(raw)
        kind = "angle" if len(name.axis) > 1 else "axis" if name.axis else "number"
        key = (name.words, name.unit, kind, name.number if name.axis else None)
        group = groups.setdefault(key, ColumnGroup(name.words, name.unit, {}, {}))
        if name.axis:
            group.by_axis.setdefault(name.axis, raw)
        else:
            group.by_number.setdefault(-1 if name.number is None else name.number, raw)
    return list(groups.values())


@dataclass(frozen=True)
class Role:
    """How the columns of a channel are named."""

    form: str
    """vector, quaternion, angles, rotors or single."""
    words: frozenset[str]
    """Names; columns without any of them are no candidates, but for a position's plain axes."""
    refused: frozenset[str] = frozenset()
    preferred: frozenset[str] = frozenset()
    mocap: float = 2.0
    """Score of words of a motion capture; -2: of an estimate; -1: of ground truth."""


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_MOCAP: Final = _set("vicon mocap optitrack motive qualisys qtm vrpn lighthouse visual pose srv")
_ESTIMATE: Final = _set(
    "est local estimate estimated estimator kalman ekf state filtered odometry"
)
_TRUTH: Final = _set("truth groundtruth gt")
_NOT_MEASURED: Final = _set(
    "sp setpoint target ctrltarget ref reference desired des goal controller pid cmd "
    "b bias cov covariance var variance std stddev noise err error delta innovation reset"
)
_LOAD: Final = _set("payload load cable pendulum sling")
_GYRO: Final = _set("gyro gyr gyroscope")
_RATES: Final = _set("w g omega angular rates rate angvel")
_ACCEL: Final = _set("acc accel accelerometer acceleration")
_QUATERNION: Final = _set("q quat quaternion orientation attitude rotation")
_SPEED: Final = _set("rpm erpm omega speed velocity w")
_POSITION: Final = _set("p pos position translation location t xyz")
ROLES: Final = {
    "position": Role(
        "vector", _POSITION,
        _GYRO | _RATES | _ACCEL | _LOAD | _set(
            "a v vel velocity speed twist mag magnetometer m force torque moment wind linear baro"
        ),
        _POSITION, 3.0,
    ),
    "quaternion": Role("quaternion", _QUATERNION, _LOAD),
    "angles": Role("angles", frozenset(), _GYRO | _RATES | _LOAD),
    "gyro": Role("vector", _GYRO | _RATES, _ACCEL | {"mag", "twist"}, _GYRO | {"imu"}, -4.0),
    "accel": Role(
        "vector", _ACCEL | {"a"}, _GYRO | {"angular"}, _ACCEL | {"imu"}, -4.0
    ),
    "rotors": Role(
        "rotors",
        _SPEED | _set("motor motors m pwm output outputs control controls actuator actuators esc "
                      "rotor rotors servo throttle cmd command u channels"),
        _QUATERNION | _ACCEL | {"a"} | _GYRO,
        _set("motor motors command cmd control controls throttle normalized"), 0.0,
    ),
    # the stamp of a message's header is the capture; another time is when it was recorded
    "time": Role(
        "single", _set("t time timestamp stamp secs seconds ts"), preferred=_set("header")
    ),
    "voltage": Role("single", _set("vbat vbatt voltage volt volts battery bat")),
    "current": Role("single", _set("current amps ibat")),
}  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """Columns that could hold a channel."""

    columns: tuple[str, ...]
    group: ColumnGroup
    score: float


def candidates(role: str, groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return the columns that could hold what a role names, best first."""
    ranked = []
    for group in groups:
        words, columns = set(group.words), _columns(ROLES[role], group)
        if not columns or words & (ROLES[role].refused | (_NOT_MEASURED - ROLES[role].words)):
            continue
        if role == "position" and group.unit not in ("", "m", "cm", "mm"):
            continue
        score = 3.0 * bool(words & ROLES[role].preferred) + ROLES[role].mocap * bool(
            words & _MOCAP
        )
        score -= 2.0 * bool(words & _ESTIMATE) + bool(words & _TRUTH)
        if role == "position" and group.words[-1:] == ("p",):
            # X.px beside X.x is the place of something else: of a payload in a Crazyflie's log
            beside = any(g.words == group.words[:-1] and "x" in g.by_axis for g in groups)
            score -= 5.0 * beside
        ranked.append(Candidate(columns, group, score + 10.0 * (role == "angles") * len(columns)))
    return sorted(ranked, key=lambda c: -c.score)


def is_estimate(group: ColumnGroup) -> bool:
    """Return whether a name says that a vehicle has estimated it."""
    return bool(_ESTIMATE & set(group.words)) and not _MOCAP & set(group.words)


def is_speed(group: ColumnGroup) -> bool:
    """Return whether the name of rotors' columns says that they are speeds."""
    return group.unit in ("rpm", "rad/s") or bool(_SPEED & set(group.words))


def _columns(role: Role, group: ColumnGroup) -> tuple[str, ...]:
    """Return the columns of a group in the order of its form; (): it has another form."""
    axes, numbers, said = group.by_axis, group.by_number, bool(role.words & set(group.words))
    if role.form == "angles":
        return tuple(axes[a] for a in ("roll", "pitch", "yaw") if a in axes)
    if role.form == "quaternion":
        if {*"wxyz"} <= set(axes):
            return tuple(axes[a] for a in "xyzw")
        return _numbered(numbers, 4) if said and set(numbers) == {0, 1, 2, 3} else ()
    if role.form == "vector":
        if {*"xyz"} <= set(axes) and "w" not in axes:
            return tuple(axes[a] for a in "xyz") if said or role is ROLES["position"] else ()
        return _numbered(numbers, 3) if said and set(numbers) == {0, 1, 2} else ()
    if role.form == "rotors":
        return _numbered(numbers, 4) if said else ()
    said |= any(group.words[-1].endswith(w) for w in role.words if group.words and len(w) > 3)
    return (numbers[-1],) if set(numbers) == {-1} and said else ()


def _numbered(numbers: dict[int, str], count: int) -> tuple[str, ...]:
    """Return the first `count` elements, from 0 or 1; (): they are not there."""
    first = min(numbers, default=-1)
    if first not in (0, 1) or any(first + i not in numbers for i in range(count)):
        return ()
    return tuple(numbers[first + i] for i in range(count))
