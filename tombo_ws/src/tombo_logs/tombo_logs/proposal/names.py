"""Meanings of the names of columns: quantity, axis, number, unit and possible channel."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from tombo_logs.readers.units import SPELLINGS, UNITS

_QUANTITIES: Final = ("m", "rad", "rad/s", "m/s", "m/s^2", "V", "A", "s")
_KNOWN: Final = {unit for quantity in _QUANTITIES for unit in UNITS[quantity]} - {"min"} | {"%"}
_UNITS: Final = {
    spelled.lower(): unit
    for spelled, unit in (*zip(_KNOWN, _KNOWN, strict=True), *SPELLINGS.items())
    if unit in _KNOWN
}
"""Unit as written, in small letters → unit."""
_ENDINGS: Final = sorted((u for u in _UNITS if re.fullmatch(r"\w+", u)), key=len, reverse=True)
_BRACKETED: Final = re.compile(r"\s*[\[(]([^\[\]()]*[A-Za-z%°][^\[\]()]*|)[\])]\s*$")
_ELEMENT: Final = re.compile(r"(\[\d+\]|\.\d+)$")
_WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_ANGLES: Final = {"roll": "roll", "pitch": "pitch", "yaw": "yaw", "heading": "yaw",
                  "phi": "roll", "theta": "pitch", "psi": "yaw"}  # fmt: skip
_STEM_AND_AXIS: Final = re.compile(
    r"(p|q|v|a|w|g|t|m|acc|accel|gyro|gyr|omega|pos|vel|mag|quat|rate|rpy)([wxyz])"
)
_ANGLE_OF: Final = {"x": "roll", "y": "pitch", "z": "yaw"}
"""Axis of a column whose name begins with rpy → angle."""


class ColumnName(NamedTuple):
    """The parts of a column's name."""

    words: tuple[str, ...]
    """Words of the name in small letters, without axis, number and unit."""
    axis: str
    """w, x, y, z, roll, pitch or yaw; empty: none."""
    number: int | None
    """Number of an element or a motor, as written."""
    unit: str


def parse_column_name(raw: str) -> ColumnName:
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
    return ColumnName(tuple(w for w in tokens if not w.isdigit()), axis, number, unit)


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


class ColumnGroup(NamedTuple):
    """Columns whose names differ in axis or number alone."""

    words: tuple[str, ...]
    unit: str
    columns: dict[str | int, str]
    """Axis, or number (-1: none) → column."""


def grouped(names: Iterable[str]) -> list[ColumnGroup]:
    """Group columns that differ in axis or number only, in order of appearance."""
    groups: dict[tuple[object, ...], ColumnGroup] = {}
    for raw in names:
        words, axis, number, unit = parse_column_name(raw)
        kind = "angle" if len(axis) > 1 else "axis" if axis else "number"
        key = (words, unit, kind, number if axis else None)
        group = groups.setdefault(key, ColumnGroup(words, unit, {}))
        group.columns.setdefault(axis or (-1 if number is None else number), raw)
    return list(groups.values())


_FORMS: Final[dict[str, Sequence[Sequence[str | int]]]] = {
    "vector": ["xyz", range(3)],
    "quaternion": ["xyzw", range(4)],
    "angles": [("roll", "pitch", "yaw")],
    "rotors": [range(4), range(1, 5)],
    "single": [(-1,)],
}
"""Form → axes or numbers of its columns, in order."""


class Role(NamedTuple):
    """How the columns of a channel are named."""

    form: str
    words: frozenset[str]
    """Names; only plain axes and angles are candidates without any of them."""
    refused: frozenset[str] = frozenset()
    preferred: frozenset[str] = frozenset()


def _set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_MOCAP: Final = _set("vicon mocap optitrack motive qualisys qtm vrpn lighthouse visual pose srv")
_ESTIMATE: Final = _set(
    "est local estimate estimated estimator kalman ekf state filtered odometry"
)
_NOT_MEASURED: Final = _set(
    "sp setpoint target ctrltarget ref reference desired des goal controller pid cmd "
    "b bias cov covariance var variance std stddev noise err error delta innovation reset"
)
_LOAD: Final = _set("payload load cable pendulum sling")
_GYRO: Final = _set("gyro gyr gyroscope")
_RATES: Final = _set("w g omega angular rates rate angvel")
_ACCEL: Final = _set("acc accel accelerometer acceleration")
_QUATERNION: Final = _set("q quat quaternion orientation attitude rotation")
_MOTOR: Final = _set("motor motors command cmd control controls throttle normalized")
_SPEED: Final = _set("rpm erpm omega speed velocity w")
_POSITION: Final = _set("p pos position translation location t xyz")
ROLES: Final = {
    "position": Role(
        "vector", _POSITION,
        _GYRO | _RATES | _ACCEL | _LOAD | _set(
            "a v vel velocity speed twist mag magnetometer m force torque moment wind linear baro"
        ),
        _POSITION,
    ),
    "quaternion": Role("quaternion", _QUATERNION, _LOAD),
    "angles": Role("angles", frozenset(), _GYRO | _RATES | _LOAD),
    "gyro": Role("vector", _GYRO | _RATES, _ACCEL | _MOCAP | {"mag", "twist"}, _GYRO | {"imu"}),
    "accel": Role("vector", _ACCEL | {"a"}, _GYRO | _MOCAP | {"angular"}, _ACCEL | {"imu"}),
    "rotors": Role(
        "rotors",
        _SPEED | _MOTOR | _set("m pwm output outputs actuator actuators esc rotor rotors servo u "
                               "channels"),
        _QUATERNION | _ACCEL | {"a"} | _GYRO, _MOTOR,
    ),
    # the stamp of a message's header is the capture; another time is when it was recorded
    "time": Role(
        "single", _set("t time timestamp stamp secs seconds ts"), preferred=_set("header")
    ),
    "voltage": Role("single", _set("vbat vbatt voltage volt volts battery bat")),
    "current": Role("single", _set("current amps ibat")),
}  # fmt: skip


class Candidate(NamedTuple):
    """Columns that could hold a channel."""

    columns: tuple[str, ...]
    group: ColumnGroup
    score: float


def candidates(role: str, groups: Sequence[ColumnGroup]) -> list[Candidate]:
    """Return the columns that could hold what a role names, best first."""
    ranked = []
    rule = ROLES[role]
    for group in groups:
        words, columns = set(group.words), _columns(rule, group)
        if not columns or words & (rule.refused | (_NOT_MEASURED - rule.words)):
            continue
        if role == "position" and group.unit not in ("", "m", "cm", "mm"):
            continue
        score = 3.0 * bool(words & rule.preferred) + 3.0 * bool(words & _MOCAP)
        score -= 2.0 * bool(words & _ESTIMATE)
        if role == "position" and group.words[-1:] == ("p",):
            # X.px in addition to X.x is another object's place: of a payload in a Crazyflie's log
            score -= 5.0 * any(g.words == group.words[:-1] and "x" in g.columns for g in groups)
        ranked.append(Candidate(columns, group, score + 10.0 * (role == "angles") * len(columns)))
    return sorted(ranked, key=lambda c: -c.score)


def is_estimate(group: ColumnGroup) -> bool:
    """Return whether a name says that a vehicle has estimated it."""
    return bool(_ESTIMATE & set(group.words)) and not _MOCAP & set(group.words)


def is_speed(group: ColumnGroup) -> bool:
    """Return whether the name of rotors' columns says that they are speeds."""
    return group.unit in UNITS["rad/s"] or bool(_SPEED & set(group.words))


def _columns(role: Role, group: ColumnGroup) -> tuple[str, ...]:
    """Return the columns of a group in the order of its form; (): it has another form."""
    there, said = group.columns, bool(role.words & set(group.words))
    if role.form == "angles":
        return tuple(there[a] for a in _FORMS["angles"][0] if a in there)
    if role.form == "single":
        said |= any(group.words[-1].endswith(w) for w in role.words if group.words and len(w) > 3)
    said |= role.form == "quaternion" and "w" in there
    said |= role is ROLES["position"] and "x" in there
    for keys in _FORMS[role.form] if said else ():
        rest = there.keys() - set(keys)
        if set(keys) <= there.keys() and (not rest or role.form == "rotors"):
            return tuple(there[key] for key in keys)
    return ()
