"""Gains of each loop of a controller, from its set points against what it then asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tombo_diagnosis.control.signals import ControlSignals
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.spans import Mask, runs

_TRIMS, _OUTLIER_SIGMAS, _LEAST_KEPT = 4, 4.0, 0.7
"""How often, from how many standard deviations on, samples are left out; share kept at least."""
_SHORTEST_S: Final = 1.0
_LIMIT: Final = (0.003, 0.005, 0.02)
"""A value is a limit if the signal is near its largest value for the first share of the time;
`near` is the second share."""
_LEAST_S, _LEAST_STRETCH, _LEAST_ROWS, _ROWS = 3.0, 5, 100, 6000
"""Time in the air, and samples of a stretch and in all, at least; samples about at most."""
_REPEATED_SHARE: Final = 0.6
"""Share of samples that are new below which what is asked for is held between them."""
_COURSE_S: Final = 0.03
"""s: standard deviation of the Gaussian before a course is differentiated."""
_SLOPE_S: Final = 0.02
"""s over which the acceleration that may be taken back is measured, at least."""
_STRUCTURE: Final = {"P": 0.04, "D": 0.04, "I": 0.08}
"""Relative standard error that filters, limits and a drifting bias leave, which no log states."""
_BLOCKS: Final = 12
"""Parts of a flight that are left out in turn, for the intervals."""
_EXPLAINED: Final = 0.7
"""Share of a loop's output that its errors must explain."""
_KNOWN: Final = 0.25
"""Half an interval over the gain, at most."""
_CUTOFFS: Final = (60.0, 125.0, 250.0, 500.0)
"""rad/s of the low-pass of a derivative that are tried."""
_DELAYS: Final = 4
"""Samples by which stamps of set points may be late or early."""
FREEDOM: Final = _BLOCKS - 1
"""Degrees of freedom of an interval."""
T975: Final = 2.2
"""Of Student's distribution with so many."""
_CASCADE: Final = 0.8
"""Correlation of the asked rate with the error of attitude from which on the one follows from
the other."""
_TURNS: Final = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class LoopGain:
    """One gain of a loop, of one flight or of several."""

    loop: str
    """rate, attitude or position; state: all at once, in moments."""
    axis: str
    term: str
    """P, I or D; of all at once with the loop that it belongs to before it."""
    unit: str
    value: float
    low: float
    high: float
    """95 % interval."""
    spread: float = 0.0
    """Standard deviation between flights."""
    flights: int = 0
    """Number of flights that show it; 0: it is known otherwise."""

    @property
    def label(self) -> str:
        """Short name."""
        return f"{self.loop} {self.axis} {self.term}"

    @property
    def known(self) -> bool:
        """Whether the flight shows it."""
        return abs(self.high - self.low) < 2.0 * _KNOWN * abs(self.value)


@dataclass(frozen=True)
class LoopFit:
    """One loop of one flight."""

    loop: str
    axis: str
    gains: tuple[LoopGain, ...]
    explained: float
    """Share of the output that its errors explain."""
    remark: str = ""
    """Why its gains are not known."""


def loop_fits(signals: ControlSignals) -> list[LoopFit]:
    """Return the gains of each loop that a flight shows."""
    error = attitude_error(signals.turns, signals.turns_asked)
    cascade = follows(signals, error, signals.rates_asked)
    inner = [*_rate_loops(signals, error, cascade), *_attitude_loops(signals, error, cascade)]
    loops = [*inner, *_position_loops(signals)]
    return loops or _state_feedback(signals)


@dataclass(frozen=True)
class _Loop:
    """The output of a loop, and the errors that may explain it."""

    name: str
    axis: str
    output: Array
    """(N,) set point of the next loop, or moment."""
    errors: Mapping[str, tuple[Array, str]]
    """Term → (N,) error, and the unit of its gain."""
    besides: Sequence[Array]
    """(N,) each: other regressors."""
    free: Mask
    """(N,) where nothing limits it."""
    fresh: Mask
    """(N,) where it is computed anew."""


def _best_fit(s: ControlSignals, loops: Sequence[_Loop], delays: Sequence[int] = (0,)) -> LoopFit:
    """Return the fit that explains most, of several forms of a loop with their errors delayed."""
    fits = [_fit(s, loop, delay) for delay in delays for loop in loops]
    return max(fits, key=lambda fit: fit.explained)


def _fit(s: ControlSignals, loop: _Loop, delay: int) -> LoopFit:
    """Regress what is asked for on delayed errors, with intervals from parts of the flight."""
    errors = [error for error, _ in loop.errors.values()]
    columns = [loop.output, *(_shifted(c, delay) for c in (*errors, *loop.besides))]
    table = np.column_stack(columns)
    rows = loop.free & np.isfinite(table).all(axis=1)
    spans = [(b, e) for b, e in runs(rows) if (e - b) * s.step > _SHORTEST_S]
    parts = [table[b:e][loop.fresh[b:e]] for b, e in spans]
    # an integral at its limit begins anew with each stretch
    parts = [part - part.mean(axis=0) for part in parts if len(part) >= _LEAST_STRETCH]
    used = sum(map(len, parts))
    if sum(e - b for b, e in spans) * s.step < _LEAST_S or used < _LEAST_ROWS:
        return LoopFit(loop.name, loop.axis, (), 0.0, f"less than {_LEAST_S:g} s in the air")
    chosen = np.vstack(parts)[:: max(used // _ROWS, 1)]
    values, deviations, explained = _trimmed(chosen[:, 1:], chosen[:, 0])
    gains = tuple(
        _gain(loop, term, v, float(np.hypot(e, _STRUCTURE[term[-1]] * v)))
        for term, v, e in zip(loop.errors, values.tolist(), deviations.tolist(), strict=False)
    )
    remark = ""
    if not explained > _EXPLAINED:
        remark = f"its errors explain {100.0 * max(explained, 0.0):.0f} % of what it asks for"
    return LoopFit(loop.name, loop.axis, gains, explained, remark)


def _gain(loop: _Loop, term: str, value: float, error: float) -> LoopGain:
    low, high = value - T975 * error, value + T975 * error
    return LoopGain(loop.name, loop.axis, term, loop.errors[term][1], value, low, high)


def _trimmed(xs: Array, ys: Array) -> tuple[Array, Array, float]:
    """Return coefficients, standard errors, and the share of the variance that they explain.

    What lies far off, as a set point at a limit that the log does not state, is left out.
    """
    scale = np.maximum(np.std(xs, axis=0), 1e-12)
    xs = xs / scale
    kept: Mask = np.ones(len(ys), np.bool_)
    parts = np.array_split(np.arange(len(ys)), _BLOCKS)
    for _ in range(_TRIMS):
        whole = _solved(xs[kept].T @ xs[kept], xs[kept].T @ ys[kept])
        rest = np.abs(ys - xs @ whole)
        far = max(
            _OUTLIER_SIGMAS * 1.4826 * float(np.median(rest)),
            float(np.quantile(rest, _LEAST_KEPT)),
        )
        kept = np.asarray(rest <= far)
    grams = np.array([xs[p][kept[p]].T @ xs[p][kept[p]] for p in parts])
    sides = np.array([xs[p][kept[p]].T @ ys[p][kept[p]] for p in parts])
    gram, side = grams.sum(axis=0), sides.sum(axis=0)
    whole = _solved(gram, side)
    left = np.array([_solved(gram - g, side - h) for g, h in zip(grams, sides, strict=True)])
    n = len(parts)
    error = np.sqrt((n - 1) / n * ((left - left.mean(axis=0)) ** 2).sum(axis=0))
    rest, free = ys[kept] - xs[kept] @ whole, ys[kept] - ys[kept].mean()
    explained = 1.0 - float(rest @ rest) / max(float(free @ free), 1e-30)
    return whole / scale, error / scale, explained


def _solved(gram: Array, side: Array) -> Array:
    return np.asarray(np.linalg.lstsq(gram, side, rcond=1e-10)[0])


def _fresh(asked: Array) -> Mask:
    """Return where (N, k) is computed anew; each row if it changes with most."""
    new = np.concatenate([[True], (np.diff(asked, axis=0) != 0.0).any(axis=1)])
    return (
        new if np.count_nonzero(new) < _REPEATED_SHARE * len(new) else np.ones(len(new), np.bool_)
    )


def _integral(values: Array, rows: Mask, step: float) -> Array:
    """Return the integral over the rows that count."""
    return np.cumsum(np.where(rows & np.isfinite(values), values, 0.0)) * step


def _shifted(values: Array, count: int) -> Array:
    """Return rows moved on by `count`; NaN where none came."""
    rows = np.arange(len(values)) - count
    known = (rows >= 0) & (rows < len(values))
    out = np.full_like(values, np.nan)
    out[known] = values[rows[known]]
    return out


def _slope(values: Array, cutoff: float, step: float) -> Array:
    """Return the derivative behind a first-order low-pass, as controllers make it."""
    a = cutoff * step / (1.0 + cutoff * step)
    smooth = lfilter([a], [1.0, a - 1.0], np.nan_to_num(values), axis=0)
    return (
        np.gradient(smooth, step, axis=0)
        if cutoff * step > 2
        else np.diff(smooth, axis=0, prepend=smooth[:1]) / step
    )


def attitude_error(turns: Rotation | None, asked: Rotation | None) -> Array | None:
    """Return (N, 3): the shortest turn that aligns body z, and the turn about it [rad]."""
    if turns is None or asked is None:
        return None
    q = (turns.inv() * asked).as_quat()
    q = np.where(q[:, 3:] < 0.0, -q, q)
    x, y, z, w = q.T
    upright = np.maximum(np.hypot(w, z), 1e-6)
    tilt = np.column_stack([w * x - y * z, w * y + x * z]) / upright[:, None]
    sine = np.maximum(np.linalg.norm(tilt, axis=1), 1e-12)
    tilt *= (2.0 * np.arctan2(sine, upright) / sine)[:, None]
    return np.column_stack([tilt, 2.0 * np.arcsin(np.clip(z / upright, -1.0, 1.0))])


def _below_limit(values: Array, rows: Mask) -> Mask:
    """Return where a size (N,) is not at a limit that it has reached for a time."""
    known = np.where(rows & np.isfinite(values), values, 0.0)
    top = float(known.max(initial=0.0))
    share, near, beside = _LIMIT
    if np.count_nonzero(known > (1.0 - near) * top) < share * max(np.count_nonzero(rows), 1):
        return np.ones(values.size, np.bool_)
    return np.asarray(np.nan_to_num(values) < (1.0 - beside) * top)


def _rate_loops(s: ControlSignals, error: Array | None, cascade: bool) -> list[LoopFit]:
    if s.moment is None or not s.gyro.size or (not cascade and error is None):
        return []
    asked = np.zeros_like(s.gyro) if s.rates_asked is None else s.rates_asked
    fits = []
    clock, unit, fresh = s.t - s.t[0], s.moment_unit, _fresh(s.moment)
    for k, axis in enumerate(_TURNS):
        off = asked[:, k] - s.gyro[:, k]
        if error is None or cascade:
            of_rate = {
                "P": (off, f"{unit} s/rad"),
                "I": (_integral(off, s.valid, s.step), f"{unit}/rad"),
            }
            slopes = [_slope(s.gyro[:, k], c, s.step) for c in _CUTOFFS] if k < 2 else []
            forms = [of_rate | {"D": (-slope, f"{unit} s^2/rad")} for slope in slopes] or [of_rate]
        else:
            e = error[:, k]
            forms = [
                {
                    "P": (e, f"{unit}/rad"),
                    "D": (off, f"{unit} s/rad"),
                    "I": (_integral(e, s.valid, s.step), f"{unit}/(rad s)"),
                }
            ]
        besides = [clock, clock**2, s.gyro[:, (k + 1) % 3] * s.gyro[:, (k + 2) % 3]]
        name, moment = "rate" if cascade else "attitude", s.moment[:, k]
        loops = [_Loop(name, axis, moment, form, besides, s.valid, fresh) for form in forms]
        fits.append(_best_fit(s, loops, range(-1, _DELAYS)))
    return fits


def follows(s: ControlSignals, error: Array | None, asked: Array | None) -> bool:
    """Return whether the asked rates follow from the error of attitude, or it is not known."""
    if asked is None:
        return False
    if error is None:
        return True
    rows = s.valid & np.isfinite(asked[:, 0])
    if np.count_nonzero(rows) < 50:
        return False
    size = float(np.std(error[rows, 0]) * np.std(asked[rows, 0]))
    return size > 0.0 and bool(np.cov(error[rows, 0], asked[rows, 0])[0, 1] > _CASCADE * size)


def _attitude_loops(s: ControlSignals, error: Array | None, cascade: bool) -> list[LoopFit]:
    asked = s.rates_asked
    if error is None or asked is None or not cascade:
        return []
    fresh = _fresh(asked)
    tilting = _below_limit(np.hypot(asked[:, 0], asked[:, 1]), s.valid)
    turning = _below_limit(np.abs(asked[:, 2]), s.valid)
    fits = []
    for k, axis in enumerate(_TURNS):
        free = s.valid & (tilting if k < 2 else turning)
        errors = {"P": (error[:, k], "1/s")}
        loop = _Loop("attitude", axis, asked[:, k], errors, [], free, fresh)
        fits.append(_best_fit(s, [loop], range(-_DELAYS, _DELAYS + 1)))
    return fits


def _position_loops(s: ControlSignals) -> list[LoopFit]:
    wanted = s.position_asked
    if s.turns_asked is None or wanted is None or not s.valid.any():
        return []
    up = s.turns_asked.apply([0.0, 0.0, 1.0])
    pushed = GRAVITY * up / np.maximum(up[:, 2:], 0.3)
    if s.thrust_asked is not None and s.turns is not None:
        along = np.einsum("ni,ni->n", up, s.turns.apply([0.0, 0.0, 1.0]))
        size = s.thrust_asked / np.maximum(along, 0.3)
        lift = np.mean((size * up[:, 2])[s.valid])  # that carries the weight, on average
        if lift > 0.0:
            pushed = GRAVITY * up * (size / lift)[:, None]
    free = s.valid & _below_limit(np.hypot(up[:, 0], up[:, 1]) / up[:, 2], s.valid)
    speed = np.zeros_like(s.position) if s.velocity_asked is None else s.velocity_asked
    fresh = _fresh(s.turns_asked.as_quat())
    every = max(round(len(fresh) / max(np.count_nonzero(fresh), 1)), round(_SLOPE_S / s.step), 1)
    pushes = s.acceleration_asked
    if pushes is None:
        pushes = np.gradient(speed, s.t, axis=0)
    taken_back = (s.velocity - _shifted(s.velocity, every)) / (every * s.step)
    fits = []
    for k, axis in enumerate("xy"):
        e, off = wanted[:, k] - s.position[:, k], speed[:, k] - s.velocity[:, k]
        errors = {
            "P": (e, "1/s^2"), "D": (off, "1/s"), "I": (_integral(e, free, s.step), "1/s^3"),
        }  # fmt: skip
        # A loop on velocity integrates what the set point's own velocity leaves: where the set
        # point jumps, that is not the error of position.
        jumped = _integral(off, free, s.step) - e
        besides = [s.t - s.t[0], pushes[:, k], taken_back[:, k], jumped]
        loop = _Loop("position", axis, pushed[:, k], errors, besides, free, fresh)
        fits.append(_best_fit(s, [loop]))
    return fits


def _state_feedback(s: ControlSignals) -> list[LoopFit]:
    """Return how moments answer position, velocity, tilt and rates, if no loop between is known.

    A cascade as a whole is linear in the state: position P, I, D and attitude P, D, in moments.
    """
    if s.moment is None or not s.gyro.size or s.turns is None or s.position_asked is None:
        return []
    smooth = max(_COURSE_S / s.step, 0.1)
    asked = gaussian_filter1d(s.position_asked, smooth, axis=0)
    speed = np.gradient(asked, s.step, axis=0)
    push = np.gradient(gaussian_filter1d(speed, smooth, axis=0), s.step, axis=0)
    up, ahead = s.turns.apply([0.0, 0.0, 1.0]), s.turns.apply([1.0, 0.0, 0.0])
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    error, slip, push, up = (
        _level(v, heading) for v in (s.position_asked - s.position, speed - s.velocity, push, up)
    )
    fits = []
    clock, unit, fresh = s.t - s.t[0], s.moment_unit, _fresh(s.moment)
    for k, (axis, other, sign) in enumerate((("roll", 1, -1.0), ("pitch", 0, 1.0))):
        e = sign * error[:, other]
        errors = {
            "position P": (e, f"{unit}/m"),
            "position D": (sign * slip[:, other], f"{unit} s/m"),
            "position I": (_integral(e, s.valid, s.step), f"{unit}/(m s)"),
            "attitude P": (-sign * up[:, other], f"{unit}/rad"),
            "attitude D": (-s.gyro[:, k], f"{unit} s/rad"),
        }
        besides = [push[:, other], clock]
        loop = _Loop("state", axis, s.moment[:, k], errors, besides, s.valid, fresh)
        fits.append(_best_fit(s, [loop], range(_DELAYS)))
    return fits


def _level(values: Array, heading: Array) -> Array:
    """Return (N, 2), ahead and to the left, of vectors (N, 3) in map."""
    c, s = np.cos(heading), np.sin(heading)
    x, y = values[:, 0], values[:, 1]
    return np.column_stack([c * x + s * y, c * y - s * x])
