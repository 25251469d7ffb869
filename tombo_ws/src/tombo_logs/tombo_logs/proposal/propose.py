"""A mapping for columns of numbers: from names, units and two tests of motion, with reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import CHANNELS
from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.spans import interpolated
from tombo_logs.proposal.motion import AGREES, BODY_AXES, CLOSE, WORLD_AXES, Reading, readings
from tombo_logs.proposal.names import Candidate, candidates, grouped, is_estimate, is_speed
from tombo_logs.readers.units import UNITS

_BITCRAZE: Final[tuple[int, ...]] = (0, 2, 3, 1)
"""Columns of the rotors front right, rear left, front left and rear right."""
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


Usable = Sequence[tuple[Candidate, Series]]
"""Columns that could hold a channel, best first, with their values."""


def propose(columns: Mapping[str, Array]) -> Proposal:
    """Propose a mapping for columns, name → (N,), NaN where a row has no value."""
    groups = grouped(columns)
    words = {word for group in groups for word in group.words}
    proposal = Proposal(is_crazyflie="stabilizer" in words or {"pm", "vbat"} <= words)
    t = _time(columns, candidates("time", groups), proposal)
    if t is None:
        return proposal
    usable = {
        role: [(c, s) for c in candidates(role, groups) if (s := _series(columns, t, c))]
        for role in ("position", "quaternion", "angles", "gyro", "accel", "rotors", *_SUPPLY)
    }
    position, gyro = usable["position"], usable["gyro"]
    forms = _attitude_forms(usable["quaternion"], usable["angles"], proposal)
    accel = _accelerometer(usable["accel"], proposal)
    allowed: list[Reading] = []
    if position and forms:
        place, track = position[0]
        track = Series(track.t, track.values * UNITS["m"][place.group.unit or "m"])
        spoken = {name: form.series for name, form in forms.items()}
        allowed = readings(track, spoken, gyro[0][1] if gyro else None, accel)
        if not allowed:
            proposal.notes.append("no reading of position and attitude agrees with gravity")
    best = allowed[0] if allowed else None
    proposal.axes += _axes(allowed)
    if position:
        proposal.channels.append(_position(position, best))
    else:
        proposal.notes.append("no columns of a position (x, y, z): needed for a diagnosis")
    if forms:
        form = forms[best.form if best else next(iter(forms))]
        doubt = _doubt(allowed, lambda r: r.form) if len(forms) > 1 else ""
        proposal.channels.append(Line("attitude", form.content, form.why, doubt))
    if gyro:
        proposal.channels.append(_gyro(*gyro[0], best))
    _rotors(usable["rotors"], proposal)
    for key in _SUPPLY:
        proposal.channels += [_supply(key, *found) for found in usable[key][:1]]
    proposal.channels.sort(key=lambda line: list(CHANNELS).index(line.key))
    return proposal


def _series(columns: Mapping[str, Array], t: Array, candidate: Candidate) -> Series | None:
    """Return the rows in which all columns have a value; None: too few, or all zero."""
    values = np.column_stack([columns[c] for c in candidate.columns])
    rows = (np.abs(values) < _LARGEST).all(axis=1) & np.isfinite(t)
    t, values = t[rows], values[rows]
    rising = np.diff(np.maximum.accumulate(t), prepend=-np.inf) > 0.0
    if np.count_nonzero(rising) < _LEAST_ROWS or not values[rising].any():
        return None
    return Series(t[rising], values[rising])


def _nearest(quantity: str, units: Sequence[str], size: float) -> str:
    """Return the unit in which a value of `size` is nearest to 1 of the quantity's unit."""
    return min(units, key=lambda unit: abs(np.log(size * UNITS[quantity][unit])))


def _time(
    columns: Mapping[str, Array], named: Sequence[Candidate], proposal: Proposal
) -> Array | None:
    """Return the times [s] of the rows: the first column that rises."""
    for candidate in named:
        (column,), unit = candidate.columns, candidate.group.unit
        steps = np.diff(columns[column][np.isfinite(columns[column])])
        if steps.size < 9 or np.mean(steps < 0.0) > 0.05 or not (steps > 0.0).any():
            continue
        step = float(np.median(steps[steps > 0.0]))
        if unit not in UNITS["s"]:
            unit = _nearest("s", ("s", "ms", "us", "ns"), step / _USUAL_STEP_S)
        rate = 1.0 / (step * UNITS["s"][unit])
        doubt = "" if 2.0 < rate < 5000.0 else f"{rate:.3g} rows/s is unusual"
        why = f"median step {step:.6g}: {rate:.4g} rows/s"
        proposal.axes.append(Line("time", {"column": column, "unit": unit}, why, doubt))
        t = columns[column] * UNITS["s"][unit]
        return np.asarray(t - np.nanmin(t))
    tried = ", ".join(c.columns[0] for c in named) or "none is named so"
    text = f"no column of times ({tried}); needed: one that rises, named time or timestamp"
    proposal.notes.append(text)
    return None


def _attitude_forms(quaternions: Usable, angles: Usable, proposal: Proposal) -> dict[str, Form]:
    """Return the forms in which the best columns of an attitude may be read."""
    for candidate, series in quaternions:
        content: dict[str, object] = {"columns": list(candidate.columns)}
        share = float(np.mean(np.abs(np.linalg.norm(series.values, axis=1) - 1.0) < 0.02))
        if share < 0.95:
            continue
        why = f"norm 1 within 2 % in {100.0 * share:.0f} % of the rows"
        as_named = Form({**content, "order": "xyzw"}, series, why)
        if "w" in candidate.group.columns:
            return {"xyzw": as_named}
        turned = Series(series.t, series.values[:, [1, 2, 3, 0]])
        why += "; order by the motion"
        return {"wxyz": Form({**content, "order": "wxyz"}, turned, why), "xyzw": as_named}
    for candidate, series in angles[:1]:
        columns, named = candidate.columns, candidate.group.unit
        lacking = sorted({"roll", "pitch", "yaw"} - candidate.group.columns.keys())
        if lacking:
            break
        high = float(np.nanpercentile(np.abs(series.values), 99.5))
        forms = {}
        for unit in [named] if named in UNITS["rad"] else ["rad", "deg"][high > 6.4 :]:
            for sign in (1.0, -1.0):
                roll, pitch, yaw = (series.values * UNITS["rad"][unit]).T
                turn = Rotation.from_euler("ZYX", np.column_stack([yaw, sign * pitch, roll]))
                names = [columns[0], "-" * (sign < 0.0) + columns[1], columns[2]]
                content = {"columns": names, "order": "rpy", "unit": unit}
                why = f"values up to {high:.3g}; unit and the sign of pitch by the motion"
                form = Form(content, Series(series.t, turn.as_quat()), why)
                forms[f"{unit} {sign:+.0f}"] = form
        return forms
    seen = [f"{', '.join(c.columns)}: {' and '.join(lacking)} not there" for c, _ in angles[:1]]
    needed = "an attitude needs roll, pitch and yaw, or a quaternion"
    proposal.notes.append("; ".join([*seen, needed]))
    return {}


def _accelerometer(usable: Usable, proposal: Proposal) -> Series | None:
    """Propose the first columns that have gravity in them."""
    for candidate, series in usable:
        columns, named = candidate.columns, candidate.group.unit
        size = float(np.median(np.linalg.norm(series.values, axis=1)))
        upright = np.linalg.norm(np.median(series.values, axis=0)) > 0.6 * size
        unit = _nearest("m/s^2", ("m/s^2", "g", "mg"), max(size, 1e-9) / GRAVITY)
        if upright and 0.8 < size * UNITS["m/s^2"][unit] / GRAVITY < 1.25:
            doubt = f"the name says {named}" if named not in ("", unit) else ""
            content = {"columns": list(columns), "unit": unit}
            why = f"median size {size:.4g}: gravity in {unit}"
            proposal.channels.append(Line("accel", content, why, doubt))
            return series
        text = f"{', '.join(columns)}: median size {size:.3g}, so gravity is not in it"
        proposal.notes.append(f"{text}; an estimator's acceleration is channel acceleration")
    return None


def _axes(allowed: Sequence[Reading]) -> list[Line]:
    """Return the axes of world and body that the motion tells, else the usual ones."""
    why, world, body = "the motion does not tell: ENU and FLU are assumed", "ENU", "FLU"
    doubt = _doubt(allowed, lambda r: f"{r.world} with {r.body}")
    if allowed:
        best, world, body = allowed[0], allowed[0].world, allowed[0].body
        tests = {"tilt with acceleration": best.tilt, "the gyro with the attitude": best.rates}
        agree = [f"{name} ({value:.2f} of 1)" for name, value in tests.items() if value == value]
        why = f"the motion agrees: {', '.join(agree)}" if agree else "gravity alone"
    if not body.isupper():
        doubt = "of the body only up is known; which axis is forward is a guess"
    return [
        Line(key, {"": name if name.isupper() else list(known[name])}, why, doubt)
        for key, name, known in (("world", world, WORLD_AXES), ("body", body, BODY_AXES))
    ]


def _doubt(allowed: Sequence[Reading], part: Callable[[Reading], str]) -> str:
    """Return what else of a part of the readings the motion agrees with nearly as well."""
    if not allowed or not allowed[0].score > AGREES:
        return "the motion agrees badly, so this is a guess: fly with more tilt"
    near = [part(r) for r in allowed if r.score > allowed[0].score - CLOSE]
    others = list(dict.fromkeys(x for x in near if x != part(allowed[0])))
    return f"{' or '.join(others[:3])} would agree as well with the motion" if others else ""


def _position(usable: Usable, best: Reading | None) -> Line:
    candidate, series = usable[0]
    unit, why = candidate.group.unit, "as named"
    if not unit:
        seconds = np.arange(series.t[0], series.t[-1] + 1.0)
        places = interpolated(seconds, series.t, series.values)
        speed = float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))
        unit, why = "m", f"it moves by {speed:.3g} a second"
        if best is not None and best.tilt > AGREES and best.slope > 0.0:
            unit = _nearest("m", ("m", "cm", "mm"), 1.0 / best.slope)
            why += f"; tilt asks for {best.slope:.3g} times its acceleration"
        elif speed > _FASTEST or not np.any(series.values % 1.0):
            unit, why = "mm", f"{why}: too fast for metres, or whole numbers"
    if len(usable) > 1:
        why += f"; there is also {', '.join(c.columns[0] for c, _ in usable[1:4])}"
    estimate = "an estimate of the vehicle, no motion capture: smoothed with its IMU"
    doubt = estimate if is_estimate(candidate.group) else ""
    return Line("position", {"columns": list(candidate.columns), "unit": unit}, why, doubt)


def _gyro(candidate: Candidate, series: Series, best: Reading | None) -> Line:
    named = {"rad": "rad/s", "deg": "deg/s"}.get(candidate.group.unit, candidate.group.unit)
    if best is not None and np.isfinite(best.rates):
        unit = _nearest("rad/s", ("rad/s", "deg/s", "mrad/s"), best.gyro_scale)
        why = f"{best.gyro_scale:.3g} times the rates of the attitude"
        doubt = f"the name says {named}" if named not in ("", unit) else ""
        if best.rates < AGREES or not 0.7 < best.gyro_scale * UNITS["rad/s"][unit] < 1.4:
            doubt = f"agrees badly with the rates of the attitude ({best.rates:.2f})"
    else:
        high = float(np.percentile(np.abs(series.values), 99))
        unit = named if named in UNITS["rad/s"] else "deg/s" if high > 15.0 else "rad/s"
        why = f"99 % of the values are below {high:.3g}"
        doubt = "" if unit == named else "too little motion to tell the unit"
    return Line("gyro", {"columns": list(candidate.columns), "unit": unit}, why, doubt)


def _rotors(usable: Usable, proposal: Proposal) -> None:
    """Propose rotor speeds and motor commands, in the order of their maker."""
    for candidate, series in usable:
        columns, unit = candidate.columns, candidate.group.unit
        low, high = float(series.values.min()), float(series.values.max())
        span, doubt = _command_range(series.values), ""
        content: dict[str, object]
        if is_speed(candidate.group):
            if unit not in UNITS["rad/s"]:
                unit = "rpm" if high > 3000.0 else "rad/s"
                doubt = "rpm and rad/s differ in size alone; "
            key, content = "rotor_speed", {"unit": unit}
        elif span is not None:
            key, content = "motor_command", {"range": list(span)}
        else:
            text = f"{', '.join(columns)}: {low:.4g} to {high:.4g} is no range of a motor"
            proposal.notes.append(text)
            continue
        if any(line.key == key for line in proposal.channels):
            proposal.notes.append(f"{', '.join(columns)} could be {key} too")
            continue
        crazyflie = proposal.is_crazyflie or span == _PWM
        maker, order = ("Bitcraze", _BITCRAZE) if crazyflie else ("PX4 and ArduCopter", range(4))
        why = f"values from {low:.4g} to {high:.4g}; order of {maker}"
        doubt += "" if crazyflie else "the order of the rotors is assumed"
        ours = {"columns": [columns[i] for i in order], **content}
        proposal.channels.append(Line(key, ours, why, doubt))


def _command_range(values: Array) -> tuple[float, float] | None:
    """Return the values of no and full power; None: these are no motor commands."""
    running = values[values > 1e-3 * values.max(initial=0.0)]
    if not running.size:
        return None
    middle = float(np.median(running))
    few, most = np.percentile(values, [30.0, 85.0])  # off for a while; the end may be damaged
    for low, full in _COMMAND_RANGES:
        size = full - low
        usual = 0.1 < (middle - low) / size <= 1.0
        if usual and few > low - 0.12 * size and most < full + 0.05 * size:
            return low, full
    return None


_SUPPLY: Final = {"voltage": "V", "current": "A"}
"""Channel → its unit."""


def _supply(key: str, candidate: Candidate, series: Series) -> Line:
    middle, unit, usual = float(np.median(series.values)), candidate.group.unit, _SUPPLY[key]
    doubt = "the unit is a guess" if key == "current" and unit not in UNITS[usual] else ""
    if unit not in UNITS[usual]:
        unit = f"m{usual}" if abs(middle) > 200.0 else usual
    return Line(
        key, {"columns": list(candidate.columns), "unit": unit}, f"median {middle:.4g}", doubt
    )
