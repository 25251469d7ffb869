"""A mapping for columns of numbers: from names, units and two tests of motion, with reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import CHANNELS
from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.rotors.rotor_order import clear_order
from tombo_logs.checks.spans import interpolated
from tombo_logs.proposal.motion import (
    AGREES,
    BODY_AXES,
    CLOSE,
    WORLD_AXES,
    Reading,
    attitude_rates,
    compare_acceleration,
    readings,
)
from tombo_logs.proposal.names import (
    Candidate,
    ColumnGroup,
    candidates,
    grouped,
    is_estimate,
    is_speed,
)
from tombo_logs.readers.frames import axes_matrix, is_usable
from tombo_logs.readers.units import UNITS

_BITCRAZE: Final[tuple[int, ...]] = (0, 2, 3, 1)
"""Columns of the rotors front right, rear left, front left and rear right."""
_PX4: Final[tuple[int, ...]] = (0, 1, 2, 3)
_PWM: Final = (0.0, 65535.0)
_COMMAND_RANGES: Final = ((0.0, 1.0), (0.0, 100.0), (0.0, 255.0), (1000.0, 2000.0), _PWM)
"""Values of a motor at rest and at full power: share, percent, byte, pulse [us], Crazyflie's."""
_LEAST_ROWS: Final = 20
_LARGEST: Final = 1e9
"""No sensor has a larger value, in any unit."""
_USUAL_STEP_S: Final = 0.01
_FASTEST: Final = 40.0
"""m/s: no vehicle flies faster under motion capture for most of a flight."""


class Line(NamedTuple):
    """One entry of a mapping."""

    key: str
    content: Mapping[str, object]
    why: str
    doubt: str = ""


class Form(NamedTuple):
    """One way to read the columns of an attitude."""

    columns: tuple[str, ...]
    content: Mapping[str, object]
    series: Series
    """(N, 4) xyzw."""
    why: str


@dataclass
class Proposal:
    """Entries of a mapping, and what it can't hold."""

    axes: list[Line] = field(default_factory=list)
    """time, world, body."""
    channels: list[Line] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    is_crazyflie: bool = False


def propose(columns: Mapping[str, Array], times: Mapping[str, Array] | None = None) -> Proposal:
    """Propose a mapping.

    Args:
        columns: name → (N,), NaN where a row has no value.
        times: name → (N,) s, of columns that have stamps; None: a column has those of all.
    """
    groups = grouped(columns)
    words = {word for group in groups for word in group.words}
    proposal = Proposal(is_crazyflie="stabilizer" in words or {"pm", "vbat"} <= words)
    if times is None:
        times = _time(columns, candidates("time", groups), proposal)
    if not times:
        return proposal
    usable = {
        role: [(c, s) for c in candidates(role, groups) if (s := _series(columns, times, c))]
        for role in ("position", "quaternion", "angles", "gyro", "accel", "rotors")
    }
    place = next(iter(usable["position"]), None)
    gyro = next(iter(usable["gyro"]), None)
    forms = _attitude_forms(usable["quaternion"], usable["angles"], proposal)
    track = None if place is None else _scaled(place[1], UNITS["m"][place[0].group.unit or "m"])
    accel = _accelerometer(usable["accel"], track, proposal)
    allowed: list[Reading] = []
    if track is not None and forms:
        spoken = {name: form.series for name, form in forms.items()}
        allowed = readings(track, spoken, None if gyro is None else gyro[1], accel)
        if not allowed:
            proposal.notes.append("no reading of position and attitude agrees with gravity")
    best = allowed[0] if allowed else None
    proposal.axes += _axes(allowed)
    if place is None:
        proposal.notes.append("no columns of a position (x, y, z): needed for a diagnosis")
    else:
        others = [c.columns[0] for c, _ in usable["position"][1:4]]
        proposal.channels.append(_position(*place, best, others))
    if forms:
        proposal.channels.append(_attitude(forms, allowed))
    body = axes_matrix(BODY_AXES["FLU" if best is None else best.body], "body")
    turning = None
    if gyro is not None:
        line, unit = _gyro(*gyro, best)
        proposal.channels.append(line)
        turning = Series(gyro[1].t, gyro[1].values @ body.T * UNITS["rad/s"][unit])
    elif best is not None:
        rates = attitude_rates(forms[best.form].series)
        turning = Series(rates.t, rates.values @ body.T)
    _rotors(usable["rotors"], turning, proposal)
    _supply(columns, groups, proposal)
    proposal.channels.sort(key=lambda line: list(CHANNELS).index(line.key))
    return proposal


def _series(
    columns: Mapping[str, Array], times: Mapping[str, Array], candidate: Candidate
) -> Series | None:
    """Return the rows in which all columns have a value; None: too few, or constant."""
    t = times[candidate.columns[0]]
    if any(columns[c].size != t.size for c in candidate.columns):
        return None
    values = np.column_stack([columns[c] for c in candidate.columns])
    rows = (np.abs(values) < _LARGEST).all(axis=1) & np.isfinite(t)
    t, values = t[rows], values[rows]
    rising = np.diff(np.maximum.accumulate(t), prepend=-np.inf) > 0.0
    if np.count_nonzero(rising) < _LEAST_ROWS or not np.ptp(values[rising], axis=0).any():
        return None
    return Series(t[rising], values[rising])


def _scaled(series: Series, factor: float) -> Series:
    return Series(series.t, factor * series.values)


def _nearest(quantity: str, units: Sequence[str], size: float) -> str:
    """Return the unit in which a value of `size` is nearest to 1 of the quantity's unit."""
    return min(units, key=lambda unit: abs(np.log(size * UNITS[quantity][unit])))


def _time(
    columns: Mapping[str, Array], named: Sequence[Candidate], proposal: Proposal
) -> dict[str, Array]:
    """Return the times [s] of all columns: those of the first column that rises."""
    for candidate in named:
        (column,), unit = candidate.columns, candidate.group.unit
        steps = np.diff(columns[column][np.isfinite(columns[column])])
        if steps.size < 9 or np.mean(steps < 0.0) > 0.05 or not (steps > 0.0).any():
            continue
        step = float(np.median(steps[steps > 0.0]))
        usual = _nearest("s", ("s", "ms", "us", "ns"), step / _USUAL_STEP_S)
        unit = unit if unit in UNITS["s"] else usual
        rate = 1.0 / (step * UNITS["s"][unit])
        doubt = f"{rate:.3g} rows/s is unusual; in {usual} it would be usual"
        why = f"median step {step:.6g}: {rate:.4g} rows/s"
        content = {"column": column, "unit": unit}
        proposal.axes.append(Line("time", content, why, "" if 2.0 < rate < 5000.0 else doubt))
        t = columns[column] * UNITS["s"][unit]
        return dict.fromkeys(columns, t - np.nanmin(t))
    tried = ", ".join(c.columns[0] for c in named)
    tried = f" ({tried}: too short, or it does not rise)" if tried else ""
    text = f"no column of times{tried}; needed: one that rises, named time or timestamp"
    proposal.notes.append(text)
    return {}


def _attitude_forms(
    quaternions: Sequence[tuple[Candidate, Series]],
    angles: Sequence[tuple[Candidate, Series]],
    proposal: Proposal,
) -> dict[str, Form]:
    """Return the forms in which the best columns of an attitude may be read."""
    for candidate, series in quaternions:
        columns, group = candidate.columns, candidate.group
        share = float(np.mean(np.abs(np.linalg.norm(series.values, axis=1) - 1.0) < 0.02))
        if share < 0.95 or not is_usable(series.values).any():
            continue
        why = f"norm 1 within 2 % in {100.0 * share:.0f} % of the rows"
        as_named = Form(columns, {"order": "xyzw"}, series, why)
        if group.by_axis:
            return {"xyzw": as_named}
        turned = Series(series.t, series.values[:, [1, 2, 3, 0]])
        return {"wxyz": Form(columns, {"order": "wxyz"}, turned, why), "xyzw": as_named}
    for candidate, series in angles:
        columns, group = candidate.columns, candidate.group
        lacking = sorted({"roll", "pitch", "yaw"} - set(group.by_axis))
        if lacking:
            proposal.notes.append(
                f"{', '.join(columns)}: {' and '.join(lacking)} not there; "
                "an attitude needs roll, pitch and yaw, or a quaternion"
            )
            return {}
        high = float(np.nanpercentile(np.abs(series.values), 99.5))
        units = ["deg"] if high > 6.4 else ["rad", "deg"]
        units = [group.unit] if group.unit in UNITS["rad"] else units
        forms = {}
        for unit in units:
            for sign in (1.0, -1.0):
                roll, pitch, yaw = (series.values * UNITS["rad"][unit]).T
                turn = Rotation.from_euler("ZYX", np.column_stack([yaw, sign * pitch, roll]))
                names = (columns[0], "-" * (sign < 0.0) + columns[1], columns[2])
                content = {"order": "rpy", "unit": unit}
                values, why = Series(series.t, turn.as_quat()), f"values up to {high:.3g}"
                forms[f"{unit} {sign:+.0f}"] = Form(names, content, values, why)
        return forms
    proposal.notes.append("no columns of an attitude (quaternion, or roll, pitch and yaw)")
    return {}


def _accelerometer(
    usable: Sequence[tuple[Candidate, Series]], track: Series | None, proposal: Proposal
) -> Series | None:
    """Propose the first columns with gravity as `accel`, those of the track as `acceleration`."""
    for candidate, series in usable:
        columns, group = candidate.columns, candidate.group
        size = float(np.median(np.linalg.norm(series.values, axis=1)))
        upright = np.linalg.norm(np.median(series.values, axis=0)) > 0.6 * size
        unit = _nearest("m/s^2", ("m/s^2", "g", "mg"), size / GRAVITY)
        if upright and 0.8 < size * UNITS["m/s^2"][unit] / GRAVITY < 1.25:
            why, key = f"median size {size:.4g}: gravity in {unit}", "accel"
        else:
            why, key = f"median size {size:.3g}, so gravity is not in it", "acceleration"
            agrees, scale = (0.0, 1.0) if track is None else compare_acceleration(track, series)
            if not agrees > AGREES:
                text = f"{', '.join(columns)}: {why}, and it is not the acceleration of the track"
                proposal.notes.append(text)
                continue
            unit = _nearest("m/s^2", ("m/s^2", "g"), scale)
            why += f"; it agrees with the track's ({agrees:.2f} of 1)"
        doubt = f"the name says {group.unit}" if group.unit not in ("", unit) else ""
        content = {"columns": list(columns), "unit": unit}
        proposal.channels.append(Line(key, content, why, doubt))
        if key == "accel":
            return series
    return None


def _axes(allowed: Sequence[Reading]) -> list[Line]:
    why, doubt, world, body = "the motion does not tell", "ENU and FLU are assumed", "ENU", "FLU"
    if allowed:
        best, world, body = allowed[0], allowed[0].world, allowed[0].body
        tests = {"tilt with acceleration": best.tilt, "the gyro with the attitude": best.rates}
        agree = [f"{name} ({value:.2f} of 1)" for name, value in tests.items() if value == value]
        why = f"the motion agrees: {', '.join(agree)}" if agree else "gravity alone"
        rivals = [r for r in _rivals(allowed) if (r.world, r.body) != (world, body)]
        doubt = "" if best.score > AGREES else "the motion agrees badly: fly with more tilt"
        if rivals:
            doubt = f"{' or '.join(f'{r.world} with {r.body}' for r in rivals[:3])} fit as well"
        if not body.isupper():
            doubt = "of the body only up is known; which axis is forward is a guess"
    return [
        Line(key, {"": name if name.isupper() else list(known[name])}, why, doubt)
        for key, name, known in (("world", world, WORLD_AXES), ("body", body, BODY_AXES))
    ]


def _rivals(allowed: Sequence[Reading]) -> list[Reading]:
    """Return the readings with which the motion agrees nearly as well as with the first."""
    return [r for r in allowed[1:] if r.score > allowed[0].score - CLOSE]


def _position(
    candidate: Candidate, series: Series, best: Reading | None, others: Sequence[str]
) -> Line:
    unit, why, doubt = candidate.group.unit, "as named", ""
    if not unit:
        extent = float(np.ptp(series.values, axis=0).max())
        seconds = np.arange(series.t[0], series.t[-1] + 1.0)
        places = interpolated(seconds, series.t, series.values)
        speed = float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))
        unit, why = "m", f"it moves by {extent:.3g}, {speed:.3g} a second"
        if best is not None and best.tilt > AGREES and best.slope > 0.0:
            unit = _nearest("m", ("m", "cm", "mm"), 1.0 / best.slope)
            why += f"; tilt asks for {best.slope:.3g} times its acceleration"
        elif speed > _FASTEST or (extent > 10.0 and not np.any(series.values % 1.0)):
            unit, why = "mm", f"{why}: too fast for metres, or whole numbers"
        elif extent > 100.0:
            doubt = "much for metres; mm?"
    if others:
        why += f"; there is also {', '.join(others)}"
    if is_estimate(candidate.group):
        doubt = "an estimate of the vehicle, no motion capture: smoothed with its IMU"
    return Line("position", {"columns": list(candidate.columns), "unit": unit}, why, doubt)


def _attitude(forms: Mapping[str, Form], allowed: Sequence[Reading]) -> Line:
    form = forms[allowed[0].form] if allowed else next(iter(forms.values()))
    why, doubt = form.why, ""
    if len(forms) > 1:
        why += "; order, sign and unit by the motion"
        rivals = sorted({r.form for r in _rivals(allowed)} - {allowed[0].form}) if allowed else []
        if rivals:
            doubt = f"{' or '.join(rivals)} would agree as well with the motion"
        if not allowed or not allowed[0].score > AGREES:
            doubt = "order and signs are a guess"
    if form.columns[1].startswith("-"):
        why += "; pitch with the other sign, as a Crazyflie logs it"
    return Line("attitude", {"columns": list(form.columns), **form.content}, why, doubt)


def _gyro(candidate: Candidate, series: Series, best: Reading | None) -> tuple[Line, str]:
    named = {"rad": "rad/s", "deg": "deg/s"}.get(candidate.group.unit, candidate.group.unit)
    if best is not None and np.isfinite(best.rates):
        unit = _nearest("rad/s", ("rad/s", "deg/s", "mrad/s"), best.gyro_scale)
        off = best.gyro_scale * UNITS["rad/s"][unit]
        why = f"{best.gyro_scale:.3g} times the rates of the attitude"
        doubt = "" if 0.7 < off < 1.4 else f"{off:.2g} times the size that {unit} would have"
        doubt = f"the name says {named}" if named not in ("", unit) else doubt
        if best.rates < AGREES:
            doubt = f"agrees badly with the rates of the attitude ({best.rates:.2f})"
    else:
        high = float(np.percentile(np.abs(series.values), 99))
        unit = named if named in UNITS["rad/s"] else "deg/s" if high > 15.0 else "rad/s"
        why = f"99 % of the values are below {high:.3g}"
        doubt = "" if unit == named else "too little motion to tell the unit"
    return Line("gyro", {"columns": list(candidate.columns), "unit": unit}, why, doubt), unit


def _rotors(
    usable: Sequence[tuple[Candidate, Series]], turning: Series | None, proposal: Proposal
) -> None:
    """Propose rotor speeds and motor commands, in the order that the motion tells."""
    for candidate, series in usable:
        columns, group = candidate.columns, candidate.group
        low, high = float(series.values.min()), float(series.values.max())
        span, key = _command_range(series.values), "motor_command"
        drive, doubts = series, []
        if is_speed(group):
            key = "rotor_speed"
            unit = "rpm" if "rpm" in group.words or high > 3000.0 else "rad/s"
            if group.unit not in UNITS["rad/s"] and "rpm" not in group.words:
                doubts.append("rpm and rad/s differ in size alone")
            unit = group.unit if group.unit in UNITS["rad/s"] else unit
            content: dict[str, object] = {"unit": unit}
        elif span is not None:
            drive = Series(series.t, np.sqrt(np.clip(series.values - span[0], 0.0, None)))
            content = {"range": list(span)}
        else:
            text = f"{', '.join(columns)}: {low:.4g} to {high:.4g} is no range of a motor"
            proposal.notes.append(text)
            continue
        if any(line.key == key for line in proposal.channels):
            proposal.notes.append(f"{', '.join(columns)} could be {key} too")
            continue
        crazyflie = proposal.is_crazyflie or content.get("range") == list(_PWM)
        maker, order = ("Bitcraze", _BITCRAZE) if crazyflie else ("PX4 and ArduCopter", _PX4)
        why = f"values from {low:.4g} to {high:.4g}; order of {maker}"
        clear = None if turning is None else clear_order(drive, turning)
        if clear is None:
            doubts.append("the motion does not tell the order of rotors")
        elif clear != order:
            order, why = clear, f"values from {low:.4g} to {high:.4g}; order by the motion"
            doubts.append(f"it is not that of {maker}")
        content = {"columns": [columns[i] for i in order], **content}
        proposal.channels.append(Line(key, content, why, "; ".join(doubts)))


def _command_range(values: Array) -> tuple[float, float] | None:
    """Return the values of no and full power; None: these are no motor commands.

    Nearly all values lie between them, or at least most: the end of a log may be damaged.
    """
    running = values[values > 1e-3 * values.max(initial=0.0)]
    middle = float(np.median(running)) if running.size else 0.0
    for share in (0.985, 0.7):
        for low, high in _COMMAND_RANGES:
            level = (values - low) / (high - low)
            inside = float(np.mean((level > -0.12) & (level < 1.05)))
            if inside >= share and 0.1 < (middle - low) / (high - low) <= 1.0:
                return low, high
    return None


def _supply(
    columns: Mapping[str, Array], groups: Sequence[ColumnGroup], proposal: Proposal
) -> None:
    for key, quantity, low, high in (("voltage", "V", 2.5, 60.0), ("current", "A", -1e3, 1e3)):
        for candidate in candidates(key, groups):
            values = columns[candidate.columns[0]]
            values = values[np.abs(values) < _LARGEST]
            if values.size < _LEAST_ROWS:
                continue
            middle, unit = float(np.median(values)), candidate.group.unit
            if unit not in UNITS[quantity]:
                unit = f"m{quantity}" if middle > 200.0 else quantity
            if low < middle * UNITS[quantity][unit] < high:
                guessed = key == "current" and unit != candidate.group.unit
                doubt = "the unit is a guess" if guessed else ""
                content = {"columns": list(candidate.columns), "unit": unit}
                proposal.channels.append(Line(key, content, f"median {middle:.4g}", doubt))
                break
