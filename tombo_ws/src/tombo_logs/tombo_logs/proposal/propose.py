"""A mapping for a table of numbers: from names, sizes and motion, each line with its reason."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import CHANNELS
from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.rotors.rotor_order import clear_order
from tombo_logs.proposal import roles
from tombo_logs.proposal.column_names import ColumnGroup, grouped, parsed
from tombo_logs.proposal.motion_evidence import (
    BODY_AXES,
    CLOSE_SCORE,
    WORLD_AXES,
    Reading,
    attitude_rates,
    readings,
    track_acceleration,
)
from tombo_logs.proposal.value_evidence import (
    Guess,
    accel_unit,
    angle_unit,
    gyro_unit,
    motor_scale,
    speed_unit,
    time_unit,
    voltage_unit,
)
from tombo_logs.readers.frames import axes_matrix, is_usable
from tombo_logs.readers.units import UNITS

_BITCRAZE, _PX4 = (0, 2, 3, 1), (0, 1, 2, 3)
"""Which of the columns front right, rear left, front left and rear right are."""
_CRAZYFLIE = {"stabilizer", "ctrltarget"}
_ENOUGH = 20
"""Rows that a channel must have."""
_LARGEST_METRES = 10.0
"""Steps that a position in whole numbers moves by at least."""
_FASTEST = 40.0
"""m/s that a vehicle under motion capture does not fly most of the time."""
_LARGEST = 1e9
"""What is larger is no value of a sensor, in any unit."""


@dataclass(frozen=True)
class Line:
    """One entry of the mapping."""

    key: str
    content: Mapping[str, object]
    why: str
    doubt: str = ""


@dataclass
class Proposal:
    """Entries of a mapping, and what it can't hold."""

    top: list[Line] = field(default_factory=list)
    """time, world, body."""
    channels: list[Line] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    is_crazyflie: bool = False


def propose(columns: Mapping[str, Array]) -> Proposal:
    """Propose a mapping for the columns of a table, (N,) each, NaN where a row has no value."""
    return _Proposer(columns).proposal


class _Proposer:
    """Finds the channels one after the other; later ones use what earlier ones have shown."""

    def __init__(self, columns: Mapping[str, Array]) -> None:
        self.proposal = Proposal()
        self._columns = columns
        self._groups = grouped(columns)
        self._t: Array = np.zeros(0)
        self._best: Reading | None = None
        self._gyro: Series | None = None
        words = {word for group in self._groups for word in group.words}
        self.proposal.is_crazyflie = bool(_CRAZYFLIE & words) or {"pm", "vbat"} <= words
        if self._time():
            self._poses_and_imu()
            self._rotors()
            self._supply()
        self.proposal.channels.sort(key=lambda line: list(CHANNELS).index(line.key))

    def _note(self, text: str) -> None:
        self.proposal.notes.append(text)

    def _add(self, key: str, why: str, doubt: str = "", **content: object) -> None:
        self.proposal.channels.append(Line(key, content, why, doubt))

    def _series(self, columns: Sequence[str], scale: float = 1.0) -> Series | None:
        """Return the rows in which all columns have a value; None: too few."""
        values = np.column_stack([self._columns[c] for c in columns])
        rows = (np.abs(values) < _LARGEST).all(axis=1) & np.isfinite(self._t)
        t = self._t[rows]
        rising = np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]]) if t.size else []
        if np.count_nonzero(rising) < _ENOUGH:
            return None
        return Series(t[rising], scale * values[rows][rising])

    def _usable(
        self, candidates: Sequence[roles.Candidate]
    ) -> Iterator[tuple[roles.Candidate, Series]]:
        """Yield candidates whose columns have values that change."""
        for candidate in candidates:
            series = self._series(candidate.columns)
            if series is not None and np.ptp(series.values, axis=0).any():
                yield candidate, series

    def _time(self) -> bool:
        named = roles.times(self._groups)
        for column in named:
            guess = time_unit(self._columns[column], parsed(column).unit)
            if guess is not None:
                content = {"column": column, "unit": guess.unit}
                self.proposal.top.append(Line("time", content, guess.why, guess.doubt))
                self._t = self._columns[column] * UNITS["s"][guess.unit]
                self._t = self._t - np.nanmin(self._t)
                return True
        tried = f" ({', '.join(named)}: too short, or it does not rise)" if named else ""
        self._note(f"no column of times{tried}; needed: one that rises, named time or timestamp")
        return False

    def _poses_and_imu(self) -> None:
        place = next(self._usable(roles.positions(self._groups)), None)
        forms = self._attitudes()
        gyro = next(self._usable(roles.rates(self._groups)), None)
        accel, unit = self._accelerometer(None if place is None else _metres(place))
        if place is None:
            self._note("no columns of a position (x, y, z): needed for a diagnosis")
        candidates: list[Reading] = []
        if place is not None and forms:
            candidates = readings(
                _metres(place), {name: form.series for name, form in forms.items()},
                None if gyro is None else gyro[1], accel,
            )  # fmt: skip
            if not candidates:
                self._note("no reading of position and attitude agrees with gravity")
        self._best = candidates[0] if candidates else None
        self._axes(candidates)
        if place is not None:
            self._position(*place)
        if forms:
            self._attitude(forms)
        if gyro is not None:
            self._add_gyro(*gyro)
        elif self._best is not None:
            rates = attitude_rates(forms[self._best.attitude].series)
            self._gyro = Series(rates.t, rates.values @ self._body().T)
        if accel is not None and unit is not None:
            columns, guess = unit
            self._add("accel", guess.why, guess.doubt, columns=list(columns), unit=guess.unit)

    def _attitudes(self) -> dict[str, _Form]:
        """Return the forms in which the best columns of an attitude may be read."""
        for candidate, series in self._usable(roles.quaternions(self._groups)):
            norm = np.linalg.norm(series.values, axis=1)
            if np.mean(np.abs(norm - 1.0) < 0.02) < 0.95 or not is_usable(series.values).any():
                continue
            share = 100.0 * np.mean(np.abs(norm - 1.0) < 0.02)
            why = f"norm 1 within 2 % in {share:.0f} % of the rows"
            if candidate.group.by_axis:
                return {"xyzw": _Form(candidate.columns, "xyzw", "", series, f"{why}, as named")}
            turned = Series(series.t, series.values[:, [1, 2, 3, 0]])
            return {
                "wxyz": _Form(candidate.columns, "wxyz", "", turned, why),
                "xyzw": _Form(candidate.columns, "xyzw", "", series, why),
            }
        for candidate, series in self._usable(roles.angles(self._groups)):
            if len(candidate.columns) < 3:
                lacking = {"roll", "pitch", "yaw"} - set(candidate.group.by_axis)
                self._note(
                    f"{', '.join(candidate.columns)}: {' and '.join(sorted(lacking))} not there; "
                    "an attitude needs roll, pitch and yaw, or a quaternion"
                )
                break
            return self._angle_forms(candidate, series)
        else:
            self._note("no columns of an attitude (quaternion, or roll, pitch and yaw)")
        return {}

    def _angle_forms(self, candidate: roles.Candidate, series: Series) -> dict[str, _Form]:
        guess = angle_unit(series.values, candidate.group.unit)
        units = ["rad", "deg"] if guess is None else [guess.unit]
        why = "values that could be either" if guess is None else guess.why
        forms = {}
        for unit in units:
            for sign in (1.0, -1.0):
                roll, pitch, yaw = (series.values * UNITS["rad"][unit]).T
                turn = Rotation.from_euler("ZYX", np.column_stack([yaw, sign * pitch, roll]))
                names = list(candidate.columns)
                names[1] = names[1] if sign > 0.0 else f"-{names[1]}"
                name = f"rpy {unit} {sign:+.0f}"
                quaternions = Series(series.t, turn.as_quat())
                forms[name] = _Form(tuple(names), "rpy", unit, quaternions, why)
        return forms

    def _accelerometer(
        self, track: Series | None
    ) -> tuple[Series | None, tuple[tuple[str, ...], Guess] | None]:
        for candidate, series in self._usable(roles.accels(self._groups)):
            guess = accel_unit(series.values, candidate.group.unit)
            if guess is not None:
                return series, (candidate.columns, guess)
            self._track_acceleration(candidate, series, track)
        return None, None

    def _track_acceleration(
        self, candidate: roles.Candidate, series: Series, track: Series | None
    ) -> None:
        """Take an acceleration without gravity as one in the world, if it is that of the track."""
        size = float(np.median(np.linalg.norm(series.values, axis=1)))
        agrees, scale = (0.0, 0.0) if track is None else track_acceleration(track, series)
        names = ", ".join(candidate.columns)
        text = f"median size {size:.3g}, so gravity is not in it"
        if not agrees > 0.5:
            self._note(f"{names}: {text}, and it is not the acceleration of the track")
            return
        unit = min(("m/s^2", "g"), key=lambda u: abs(np.log(scale * UNITS["m/s^2"][u])))
        named = candidate.group.unit
        self._add(
            "acceleration",
            f"{text}; it agrees with the track's ({agrees:.2f} of 1), {scale:.3g} times its size",
            f"the name says {named}" if named and named != unit else "",
            columns=list(candidate.columns),
            unit=unit,
        )

    def _axes(self, candidates: Sequence[Reading]) -> None:
        best = self._best
        if best is None:
            why, doubt = "not to be told here", "ENU and FLU are assumed"
        else:
            why = _evidence(best)
            rivals = [r for r in candidates[1:] if (r.world, r.body) != (best.world, best.body)]
            close = [r for r in rivals if r.score > best.score - CLOSE_SCORE]
            doubt = ""
            if not best.score > 0.5:
                doubt = "the motion agrees badly; fly with more lean, or look at the axes"
            if close:
                texts = " or ".join(f"{r.world} with {r.body}" for r in close[:3])
                doubt = f"{texts} would do as well"
            if "up" in best.body or "down" in best.body:
                doubt = "of the body only up is known; which axis is forward is a guess"
        world, body = ("ENU", "FLU") if best is None else (best.world, best.body)
        for key, name, known in (("world", world, WORLD_AXES), ("body", body, BODY_AXES)):
            axes = name if name.isupper() else list(known[name])
            self.proposal.top.append(Line(key, {"": axes}, why, doubt))

    def _position(self, candidate: roles.Candidate, series: Series) -> None:
        unit, why, doubt = candidate.group.unit or "m", "as named", ""
        slope = float("nan") if self._best is None else self._best.slope
        if not candidate.group.unit:
            extent = float(np.ptp(series.values, axis=0).max())
            why = f"it moves by {extent:.3g}"
            if slope > 0.0 and self._best is not None and self._best.lean > 0.5:
                unit = min(("m", "cm", "mm"), key=lambda u: abs(np.log(slope / UNITS["m"][u])))
                why += f", and lean calls for {slope:.3g} times the acceleration"
            elif extent > _LARGEST_METRES and not np.any(series.values % 1.0):
                unit, why = "mm", f"{why} in whole numbers, too coarse for metres"
            elif (speed := _usual_speed(series)) > _FASTEST:
                unit, why = "mm", f"{why} at {speed:.3g} a second, too fast for metres"
            elif extent > 100.0:
                doubt = "much for metres; mm?"
        others = [c.text for c in roles.positions(self._groups) if c.columns != candidate.columns]
        also = f"; there is also {', '.join(others[:3])}" if others else ""
        if roles.is_estimate(candidate.group):
            doubt = "an estimate of the vehicle, no motion capture: smoothed with its IMU"
        self._add("position", why + also, doubt, columns=list(candidate.columns), unit=unit)

    def _attitude(self, forms: Mapping[str, _Form]) -> None:
        best = self._best
        form = forms[best.attitude] if best is not None else next(iter(forms.values()))
        why, doubt = form.why, ""
        if len(forms) > 1:
            why += "; the motion says so" if best is not None else ""
            doubt = "" if best is not None and best.score > 0.5 else "order and signs are a guess"
        if form.columns[1].startswith("-"):
            why += "; pitch with the other sign, as a Crazyflie logs it"
        content: dict[str, object] = {"columns": list(form.columns), "order": form.order}
        if form.unit:
            content["unit"] = form.unit
        self._add("attitude", why, doubt, **content)

    def _add_gyro(self, candidate: roles.Candidate, series: Series) -> None:
        scale = float("nan") if self._best is None else self._best.gyro_scale
        guess = gyro_unit(scale, series.values, candidate.group.unit)
        doubt = guess.doubt
        if self._best is not None and self._best.rates < 0.5:
            doubt = f"agrees badly with the rates of the attitude ({self._best.rates:.2f})"
        values = series.values @ self._body().T * UNITS["rad/s"][guess.unit]
        self._gyro = Series(series.t, values)
        self._add("gyro", guess.why, doubt, columns=list(candidate.columns), unit=guess.unit)

    def _body(self) -> Array:
        return axes_matrix(BODY_AXES["FLU" if self._best is None else self._best.body], "body")

    def _rotors(self) -> None:
        taken: set[str] = set()
        for candidate, series in self._usable(roles.rotors(self._groups)):
            speeds = roles.is_speed(candidate.group)
            key = "rotor_speed" if speeds else "motor_command"
            scale = None if speeds else motor_scale(series.values)
            if not speeds and scale is None:
                low, high = series.values.min(), series.values.max()
                self._note(f"{candidate.text}: {low:.4g} to {high:.4g} is no range of a motor")
                continue
            if key in taken:
                self._note(f"{', '.join(candidate.columns)} could be {key} too")
                continue
            taken.add(key)
            order, why, doubt = self._order(candidate.group, series, scale)
            columns = [candidate.columns[i] for i in order]
            if scale is not None:
                low, high = series.values.min(), series.values.max()
                text = f"values from {low:.4g} to {high:.4g}; {why}"
                self._add(key, text, doubt, columns=columns, range=list(scale))
                continue
            guess = speed_unit(series.values, candidate.group.unit, candidate.group.words)
            doubts = "; ".join(text for text in (guess.doubt, doubt) if text)
            self._add(key, f"{guess.why}; {why}", doubts, columns=columns, unit=guess.unit)

    def _order(
        self, group: ColumnGroup, series: Series, scale: tuple[float, float] | None
    ) -> tuple[Sequence[int], str, str]:
        """Return which column each of our rotors is, why, and what is doubtful."""
        if self.proposal.is_crazyflie or scale == (0.0, 65535.0):
            named, maker = _BITCRAZE, "Bitcraze's M1 to M4"
        else:
            named, maker = _PX4, "PX4's and ArduCopter's quad-X"
        drive = series
        if scale is not None:
            drive = Series(series.t, np.sqrt(np.clip(series.values - scale[0], 0.0, None)))
        clear = None if self._gyro is None else clear_order(drive, self._gyro)
        if clear == named:
            return named, f"order of {maker}, and the motion says so", ""
        if clear is not None:
            return clear, "order as the motion says", f"it is not that of {maker}"
        return named, f"order of {maker}", "the motion does not tell the order of rotors"

    def _supply(self) -> None:
        for column in roles.voltages(self._groups):
            series = self._series([column])
            if series is None:
                continue
            guess = voltage_unit(series.values, parsed(column).unit)
            if not guess.doubt:
                self._add("voltage", guess.why, columns=[column], unit=guess.unit)
                break
        for column in roles.currents(self._groups):
            if self._series([column]) is not None:
                unit = parsed(column).unit
                doubt = "" if unit in UNITS["A"] else "the unit is a guess"
                unit = unit if unit in UNITS["A"] else "A"
                self._add("current", "as named", doubt, columns=[column], unit=unit)
                break


@dataclass(frozen=True)
class _Form:
    """One way to read the columns of an attitude."""

    columns: tuple[str, ...]
    order: str
    unit: str
    series: Series
    """(N, 4) xyzw."""
    why: str


def _metres(place: tuple[roles.Candidate, Series]) -> Series:
    candidate, series = place
    return Series(series.t, series.values * UNITS["m"][candidate.group.unit or "m"])


def _usual_speed(series: Series) -> float:
    """Return the median distance from one second to the next."""
    t = np.arange(series.t[0], series.t[-1], 1.0)
    if t.size < 2:
        return 0.0
    places = np.column_stack([np.interp(t, series.t, column) for column in series.values.T])
    return float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))


def _evidence(reading: Reading) -> str:
    parts = []
    if np.isfinite(reading.lean):
        parts.append(f"lean agrees with acceleration ({reading.lean:.2f} of 1)")
    if np.isfinite(reading.rates):
        parts.append(f"the gyro with the attitude ({reading.rates:.2f})")
    return ", ".join(parts) or "gravity alone"
