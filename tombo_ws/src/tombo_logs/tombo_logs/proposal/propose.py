"""Proposes a mapping for the columns of a table, by their names, units and sizes.

Axes are assumed. The checks of the log compare them with the motion, and say which are wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from tombo_bag.channels import CHANNELS
from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.proposal.names import ROLES, Candidate, candidates, grouped, is_estimate, is_speed
from tombo_logs.readers.units import UNITS

_BITCRAZE: Final[tuple[int, ...]] = (0, 2, 3, 1)
"""Columns of the rotors front right, rear left, front left and rear right."""
_PWM: Final = (0.0, 65535.0)
_COMMAND_RANGES: Final = ((0.0, 1.0), (0.0, 100.0), (0.0, 255.0), (1000.0, 2000.0), _PWM)
"""Values of a motor at rest and at full power: share, percent, byte, pulse [us], Crazyflie's."""
_LEAST_ROWS: Final = 20
_USUAL_STEP_S: Final = 0.01
_BY_SIZE: Final = {
    "position": (100.0, "m", "mm"),
    "attitude": (2.0 * np.pi, "rad", "deg"),
    "gyro": (15.0, "rad/s", "deg/s"),
    "rotor_speed": (3000.0, "rad/s", "rpm"),
    "voltage": (100.0, "V", "mV"),
    "current": (200.0, "A", "mA"),
}
"""Channel → value that is hardly ever exceeded in its unit, this unit, and that of larger ones."""


class Line(NamedTuple):
    """One entry of a mapping."""

    key: str
    content: Mapping[str, object]
    why: str
    question: str = ""


@dataclass
class Proposal:
    """Entries of a mapping, and notes on columns that it can't hold."""

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
        for role in ROLES
        if role != "time"
    }
    doubt = "" if proposal.is_crazyflie else "assumed; the checks compare it with the motion"
    proposal.axes += [
        Line("world", {"": "ENU"}, "x, y, z of the file are east, north, up", doubt),
        Line("body", {"": "FLU"}, "x, y, z of the vehicle are forward, left, up", doubt),
    ]
    if not usable["position"]:
        proposal.notes.append("no columns of a position (x, y, z): needed for a diagnosis")
    for key in ("position", "gyro", "voltage", "current"):
        proposal.channels += [_vector(key, usable[key])] if usable[key] else []
    _attitude(usable["quaternion"], usable["angles"], proposal)
    _accelerometer(usable["accel"], proposal)
    _rotors(usable["rotors"], proposal)
    proposal.channels.sort(key=lambda line: list(CHANNELS).index(line.key))
    return proposal


def _series(columns: Mapping[str, Array], t: Array, candidate: Candidate) -> Series | None:
    """Return the rows in which all columns have a value; None: too few, or all zero."""
    values = np.column_stack([columns[c] for c in candidate.columns])
    rows = np.isfinite(values).all(axis=1) & np.isfinite(t)
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


def _attitude(quaternions: Usable, angles: Usable, proposal: Proposal) -> None:
    """Propose the first columns that are unit quaternions, else roll, pitch and yaw."""
    for candidate, series in quaternions:
        share = float(np.mean(np.abs(np.linalg.norm(series.values, axis=1) - 1.0) < 0.02))
        if share < 0.95:
            continue
        why, order, doubt = f"norm 1 within 2 % in {100.0 * share:.0f} % of the rows", "xyzw", ""
        if "w" not in candidate.group.columns:
            first, *_, last = np.median(np.abs(series.values), axis=0)
            order = "wxyz" if first > last else "xyzw"
            doubt = "wxyz or xyzw? w is near 1 in a flight with heading 0"
        content = {"columns": list(candidate.columns), "order": order}
        proposal.channels.append(Line("attitude", content, why, doubt))
        return
    for candidate, series in angles[:1]:
        lacking = sorted({"roll", "pitch", "yaw"} - candidate.group.columns.keys())
        if lacking:
            text = f"{', '.join(candidate.columns)}: {' and '.join(lacking)} not there"
            proposal.notes.append(text)
            break
        roll, pitch, yaw = candidate.columns
        # the Crazyflie's firmware counts it upwards
        pitch = "-" * ("stabilizer" in candidate.group.words) + pitch
        unit, why, doubt = _unit("attitude", candidate, series)
        content = {"columns": [roll, pitch, yaw], "order": "rpy", "unit": unit}
        proposal.channels.append(Line("attitude", content, why, doubt))
        return
    proposal.notes.append("an attitude needs roll, pitch and yaw, or a quaternion")


def _accelerometer(usable: Usable, proposal: Proposal) -> None:
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
            return
        text = f"{', '.join(columns)}: median size {size:.3g}, so gravity is not in it"
        proposal.notes.append(f"{text}; an estimator's acceleration is channel acceleration")


def _vector(key: str, usable: Usable) -> Line:
    candidate, series = usable[0]
    unit, why, doubt = _unit(key, candidate, series)
    if key == "position" and is_estimate(candidate.group):
        doubt = "an estimate of the vehicle, no motion capture: smoothed with its IMU"
    return Line(key, {"columns": list(candidate.columns), "unit": unit}, why, doubt)


def _unit(key: str, candidate: Candidate, series: Series) -> tuple[str, str, str]:
    """Return the unit that a name says, else the one that the size suggests; reason, and doubt."""
    limit, usual, larger = _BY_SIZE[key]
    named = candidate.group.unit
    for unit in (named, f"{named}/s"):
        if unit in UNITS[usual]:
            return unit, "unit as named", ""
    high = float(np.percentile(np.abs(series.values), 99.0))
    unit = larger if high > limit else usual
    return unit, f"99 % of the values are below {high:.3g}", "the unit is guessed from the size"


def _rotors(usable: Usable, proposal: Proposal) -> None:
    """Propose rotor speeds and motor commands, in the order of their maker."""
    for candidate, series in usable:
        columns = candidate.columns
        low, high = float(series.values.min()), float(series.values.max())
        span, doubt = _command_range(series.values), ""
        content: dict[str, object]
        if is_speed(candidate.group):
            unit, _, doubt = _unit("rotor_speed", candidate, series)
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
        if not crazyflie:
            doubt = "; ".join(filter(None, (doubt, "the order of the rotors is assumed")))
        ours = {"columns": [columns[i] for i in order], **content}
        proposal.channels.append(Line(key, ours, why, doubt))


def _command_range(values: Array) -> tuple[float, float] | None:
    """Return the values of no and full power; None: the values fit no range."""
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
