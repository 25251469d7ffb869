"""What the name of a column tells: words, axis, number and unit."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

_UNITS = {
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
"""As written, in small letters → unit; longest first where one ends in another."""
_BY_LENGTH = sorted((u for u in _UNITS if re.fullmatch(r"\w+", u)), key=len, reverse=True)
_BRACKETED = re.compile(r"\s*[\[(]([^\[\]()]*[A-Za-z%][^\[\]()]*|)[\])]\s*$")
_ELEMENT = re.compile(r"(\[\d+\]|\.\d+)$")
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_ANGLES = {"roll": "roll", "pitch": "pitch", "yaw": "yaw", "heading": "yaw",
           "phi": "roll", "theta": "pitch", "psi": "yaw"}  # fmt: skip
_STEM_AND_AXIS = re.compile(
    r"(p|q|v|a|w|g|t|m|acc|accel|gyro|gyr|omega|pos|vel|mag|quat|rate|rpy)([wxyz])"
)
_ANGLE_OF = {"x": "roll", "y": "pitch", "z": "yaw"}
"""Of a column whose name begins with rpy."""


@dataclass(frozen=True)
class ColumnName:
    """A name, taken apart."""

    raw: str
    words: tuple[str, ...]
    """In small letters, without axis, number and unit."""
    axis: str = ""
    """w, x, y, z, roll, pitch or yaw."""
    number: int | None = None
    """Of an element or a motor, as written."""
    unit: str = ""


def parsed(raw: str) -> ColumnName:
    """Take a name apart: `imu_acc_x`, `a_RS_S_x [m s^-2]`, `esc[0].esc_rpm`, `motor.m1`."""
    text, unit = raw.strip().lstrip("#").strip(), ""
    bracket = _BRACKETED.search(text)
    if bracket is not None:
        unit = _UNITS.get(bracket[1].strip().lower(), "")
        text = text[: bracket.start()]
    text, unit = _without_unit(text, unit)
    tokens = [word.lower() for word in _WORD.findall(text)]
    axis = _take_axis(tokens)
    number = next((int(word) for word in reversed(tokens) if word.isdigit()), None)
    words = tuple(word for word in tokens if not word.isdigit())
    return ColumnName(raw, words, axis, number, unit)


def _without_unit(text: str, unit: str) -> tuple[str, str]:
    """Take a unit off the end, or off from before a number in brackets: `gyro_rad[0]`."""
    if unit:
        return text, unit
    element = _ELEMENT.search(text)
    name, number = (text, "") if element is None else (text[: element.start()], element[0])
    for ending in _BY_LENGTH:
        stem = name[: -len(ending)]
        if name.lower().endswith(ending) and len(stem) > 1 and stem[-1] in "_./ ":
            return stem.rstrip("_./ ") + number, _UNITS[ending]
    return text, unit


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
    """Columns that belong together."""

    words: tuple[str, ...]
    unit: str
    by_axis: dict[str, str]
    """Axis → column."""
    by_number: dict[int, str]
    """Number → column, of those without an axis."""

    def has(self, *words: str) -> bool:
        """Return whether one of these words is in the name."""
        return bool(set(words) & set(self.words))


def grouped(names: Iterable[str]) -> list[ColumnGroup]:
    """Put columns together that differ in axis or number only, in order of appearance."""
    groups: dict[tuple[object, ...], ColumnGroup] = {}
    for raw in names:
        name = parsed(raw)
        kind = "angle" if len(name.axis) > 1 else "axis" if name.axis else "number"
        number = name.number if name.axis else None
        key = (name.words, name.unit, kind, number)
        group = groups.setdefault(key, ColumnGroup(name.words, name.unit, {}, {}))
        if name.axis:
            group.by_axis.setdefault(name.axis, raw)
        else:
            group.by_number.setdefault(-1 if name.number is None else name.number, raw)
    return list(groups.values())
