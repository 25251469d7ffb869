"""The page of any logs: set points, the flight, and how well it was measured.

Its questions are those of PX4's Flight Review; up to six flights share the plots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from tombo_bag.channels import CHANNELS, ROTOR_SPEED
from tombo_bag.flight import Flight, Series, finding_mapping
from tombo_bag.topics import (
    ATTITUDE_SETPOINT,
    BATTERY,
    DETECTOR_STATUS,
    IMU,
    MOCAP_POSE,
    ODOMETRY,
    RATES_SETPOINT,
    ROTOR_COMMAND,
    SETPOINT,
)
from tombo_diagnosis.crash.reason import Why
from tombo_diagnosis.report.page import check_items
from tombo_diagnosis.wording import DASH, display_name, figure
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_flight.report import style
from tombo_flight.report.page import Page, Picture, Section, Table, Text
from tombo_flight.report.style import new_figure
from tombo_logs.checks.even_flight import held_values
from tombo_logs.checks.spans import interpolated

MOST_LOGS: Final = 6
_COLOURS: Final = (
    *(style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY),
)
_OF_LINE: Final = {"-": style.BLUE, "-.": style.ORANGE, ":": style.VERMILLION}
"""Colours of a single log."""
_MAX_SAMPLES: Final = 4000
"""Largest number of samples of a curve."""
_MIN_GAP_MEDIANS: Final = 2.5
"""Medians; a longer interval is a gap."""
_MIN_SATURATED_SHARE: Final = 0.995
"""Share of its largest value from which on a motor command counts as at its limit."""
_XYZ: Final = ("x", "y", "z")
_ANGLES: Final = ("yaw", "pitch", "roll")


@dataclass(frozen=True)
class LogCurve:
    """A field of a topic, as one line style in the panels of its components."""

    topic: str
    field: str
    name: str
    line: str = "-"


@dataclass(frozen=True)
class Panels:
    """A picture: one panel a component."""

    title: str
    unit: str
    components: Sequence[str]
    curves: Sequence[LogCurve]
    values: Callable[[Array], Array] = lambda values: values
    """From the field's values to the drawn ones, (N, components)."""


def _angles(quaternions: Array) -> Array:
    """Return yaw, pitch, roll [°] of quaternions xyzw."""
    return np.degrees(yaw_pitch_roll(quaternions))


_PICTURES: Final = (
    Panels("Position", "m", _XYZ, (
        LogCurve(MOCAP_POSE.name, "position", "measured"),
        LogCurve(ODOMETRY.name, "position", "estimate", "-."),
        LogCurve(SETPOINT.name, "position", "set point", ":"),
    )),
    Panels("Attitude", "°", _ANGLES, (
        LogCurve(MOCAP_POSE.name, "attitude", "measured"),
        LogCurve(ATTITUDE_SETPOINT.name, "orientation", "set point", ":"),
    ), _angles),
    Panels("Body rates", "rad/s", _XYZ, (
        LogCurve(IMU.name, "gyro", "measured"),
        LogCurve(RATES_SETPOINT.name, "rates", "set point", ":"),
    )),
    Panels("Rotors", "", ("front right", "rear left", "front left", "rear right"), (
        LogCurve(ROTOR_COMMAND.name, "speed", "asked for [rad/s]", ":"),
        LogCurve(ROTOR_SPEED, "speed", "measured [rad/s]"),
        LogCurve("/motor_command", "command", "command, 0 to 1"),
    )),
    Panels("Battery", "V, A", ("",), (
        LogCurve(BATTERY.name, "voltage", "voltage"),
        LogCurve(BATTERY.name, "current", "current", ":"),
    )),
    Panels("Test of each pose", "–", ("statistic",), (
        LogCurve(DETECTOR_STATUS.name, "statistic", "innovation"),
        LogCurve("/estimator/innovation", "ratio", "PX4's test ratio"),
    )),
)  # fmt: skip


def log_page(flights: Sequence[Flight], reasons: Sequence[Why | InputError]) -> Page:
    """Return the page of logs.

    Args:
        flights: at most six, checked (`check_log`) or not.
        reasons: why each of them went wrong, or what forbids to say it.

    Raises:
        InputError: none, or more than six flights.
    """
    if not 1 <= len(flights) <= MOST_LOGS:
        raise InputError(f"{len(flights)} logs; accepted: 1 to {MOST_LOGS}")
    figures = [log_figures(flight) for flight in flights]
    pictures = [_panels_picture(flights, panels) for panels in _PICTURES]
    rows = [
        [name, *(DASH if (x := each[name]) is None else figure(x, 4) for each in figures)]
        for name in figures[0]
        if any(each[name] is not None for each in figures)
    ]
    names = [flight.name or flight.source for flight in flights]
    spectra = _spectra_picture(flights)
    findings = [finding for flight in flights for finding in flight.findings]
    one = len(flights) == 1
    return Page(
        title=f"Logs: {', '.join(names)}",
        eyebrow="Tombo report",
        headline=names[0] if one else f"{len(flights)} logs",
        summary="; ".join(flight.source for flight in flights if flight.source),
        sections=[
            Section("Figures", [Table(["", *names], rows)]),
            Section("First diagnosis", [_diagnosis(names, reasons)]),
            Section("Asked for and flown", [p for p in pictures if p is not None], "page"),
            Section("Vibration", [spectra] if spectra else [], "page"),
            Section("Events", _events(names, flights)),
            Section("Checks of the logs", check_items(findings, "log")),
        ],
        data={"logs": [_log_data(*row) for row in zip(flights, figures, reasons, strict=True)]},
    )


def log_figures(flight: Flight) -> dict[str, float | None]:
    """Return the figures of a log by name with unit; None: it does not have what they need."""
    values = {name: series.values for name, series in flight.series.items()}
    pose, commands = flight.series.get("position"), values.get("motor_command")
    stamps = np.zeros(0) if pose is None else np.unique(pose.t[np.isfinite(pose.t)])
    interval = np.diff(stamps) if stamps.size > 2 else None
    usual = _of_known(np.median, interval)
    late = None if pose is None or pose.arrival is None else 1e3 * (pose.arrival - pose.t)
    if (_of_known(np.median, late) or 0.0) < 0.0:
        late = None  # stamps later than arrival are of another clock
    top = max(_of_known(np.max, commands) or 0.0, 1.0)
    limited = None
    if commands is not None:
        limited = np.asarray(np.any(commands >= _MIN_SATURATED_SHARE * top, axis=1), np.float64)
    lengths = {
        name: np.linalg.norm(values[name], axis=1) for name in ("accel", "gyro") if name in values
    }
    return {
        "duration [s]": flight.duration_s,
        "poses [Hz]": None if usual is None else 1.0 / usual,
        "gaps between poses": _of_known(
            lambda x: np.sum(x > _MIN_GAP_MEDIANS * np.median(x)), interval
        ),
        "longest gap [ms]": _of_known(lambda x: 1e3 * np.max(x), interval),
        "latency of poses, median [ms]": _of_known(np.median, late),
        "latency of poses, 95 % [ms]": _of_known(lambda x: np.percentile(x, 95), late),
        "error of position, RMS [m]": tracking_error(flight, MOCAP_POSE.name, SETPOINT.name,
                                                     "position", "position"),
        "error of rates, RMS [rad/s]": tracking_error(flight, IMU.name, RATES_SETPOINT.name,
                                                      "gyro", "rates"),
        "vibration, RMS above 30 Hz [m/s²]": vibration(flight.series.get("accel")),
        "largest specific force [m/s²]": _of_known(np.max, lengths.get("accel")),
        "largest body rate [rad/s]": _of_known(np.max, lengths.get("gyro")),
        "time of a motor at its limit [%]": _of_known(lambda x: 100.0 * np.mean(x), limited),
        "lowest voltage [V]": _of_known(np.min, values.get("voltage")),
    }  # fmt: skip


def tracking_error(
    flight: Flight, measured: str, asked: str, field: str, asked_field: str
) -> float | None:
    """Return the root mean square of measured minus asked for; None where one is missing.

    A set point holds until the next message; before the first there is none.
    """
    real = flight.topics[measured].get(field) if measured in flight.topics else None
    wanted = flight.topics[asked].get(asked_field) if asked in flight.topics else None
    if real is None or wanted is None or not len(wanted.t) or not len(real.t):
        return None
    with np.errstate(invalid="ignore"):  # of values that are not finite
        error = real.values - held_values(real.t, wanted.t, wanted.values)
    error = error[np.isfinite(error).all(axis=1) & (real.t >= wanted.t[0])]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) if len(error) else None


def vibration(accel: Series | None) -> float | None:
    """Return the root mean square of the specific force above 30 Hz [m/s²]."""
    spectrum = None if accel is None else spectrum_of(accel)
    if spectrum is None or spectrum[0][-1] < 60.0:
        return None
    frequency, power = spectrum
    above = frequency > 30.0
    return float(np.sqrt(np.trapezoid(power[above].sum(axis=1), frequency[above])))


def spectrum_of(series: Series) -> tuple[Array, Array] | None:
    """Return frequencies [Hz] and power densities (N, width).

    None: too short, irregular, or without any motion.
    """
    usable = np.isfinite(series.t) & np.isfinite(series.values).all(axis=1)
    t, first = np.unique(series.t[usable], return_index=True)
    values = series.values[usable][first]
    if len(t) < 256 or not np.ptp(values, axis=0).any():
        return None
    rate = 1.0 / float(np.median(np.diff(t)))
    if not 256 <= (t[-1] - t[0]) * rate <= 20 * len(t):
        return None
    even = np.arange(t[0], t[-1], 1.0 / rate)
    evened = interpolated(even, t, values)
    frequency, power = welch(evened, rate, nperseg=min(1024, len(even)), axis=0)
    return frequency, power


def _of_known(compute: Callable[[Array], Any], values: Array | None) -> float | None:
    """Return a figure of the finite values; None: there are none."""
    known = None if values is None else values[np.isfinite(values)]
    return None if known is None or not known.size else float(compute(known))


def _has(flight: Flight, curve: LogCurve) -> bool:
    return curve.topic in flight.topics and curve.field in flight.topics[curve.topic]


def _panels_picture(flights: Sequence[Flight], panels: Panels) -> Picture | None:
    there = [c for c in panels.curves if any(_has(flight, c) for flight in flights)]
    if not there:
        return None
    lines = {"-": "line", "-.": "dash-dotted", ":": "dotted"}
    words = ", ".join(f"{curve.name}: {lines[curve.line]}" for curve in there)
    return Picture(partial(draw_panels, flights, panels), words, panels.title)


def draw_panels(flights: Sequence[Flight], panels: Panels) -> Figure:
    """Draw the components of a quantity, all flights from their own beginning."""
    count = len(panels.components)
    with new_figure(9.0, 0.8 + 1.35 * count, 100, layout="constrained") as sheet:
        column = sheet.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for number, flight in enumerate(flights):
            for curve in panels.curves:
                if _has(flight, curve):
                    series = flight.topics[curve.topic][curve.field]
                    colour = _OF_LINE[curve.line] if len(flights) == 1 else _COLOURS[number]
                    step = len(series.t) // _MAX_SAMPLES + 1
                    values = np.where(np.isfinite(series.values), series.values, np.nan)[::step]
                    drawn = panels.values(values).reshape(len(values), -1)
                    t = series.t[::step] - _start(flight)
                    for ax, y in zip(column, drawn.T, strict=False):
                        ax.plot(t, y, curve.line, color=colour, linewidth=1.0)
        for ax, name in zip(column, panels.components, strict=True):
            unit = f" [{panels.unit}]" if panels.unit else ""
            ax.set_ylabel(f"{name}{unit}")
        _legend(column[0], flights)
        column[-1].set_xlabel("time [s]")
    return sheet


def _start(flight: Flight) -> float:
    return min((float(s.t[0]) for s in flight.series.values() if len(s.t)), default=0.0)


def _legend(ax: Axes, flights: Sequence[Flight]) -> None:
    if len(flights) > 1:
        for flight, colour in zip(flights, _COLOURS, strict=False):
            ax.plot([], [], color=colour, label=flight.name)
        ax.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)


def _spectra_picture(flights: Sequence[Flight]) -> Picture | None:
    channels = [
        name
        for name in ("gyro", "accel")
        if any(name in f.series and spectrum_of(f.series[name]) for f in flights)
    ]
    if not channels:
        return None
    draw = partial(_draw_spectra, flights, channels)
    return Picture(draw, "Power density, sum of the three axes", "Spectra")


def _draw_spectra(flights: Sequence[Flight], channels: Sequence[str]) -> Figure:
    with new_figure(9.0, 2.6, 100, layout="constrained") as sheet:
        row = sheet.subplots(1, len(channels), squeeze=False)[0]
        for ax, name in zip(row, channels, strict=True):
            for flight, colour in zip(flights, _COLOURS, strict=False):
                spectrum = spectrum_of(flight.series[name]) if name in flight.series else None
                if spectrum is not None:
                    ax.semilogy(spectrum[0][1:], spectrum[1][1:].sum(axis=1), color=colour,
                                linewidth=1.0)  # fmt: skip
            ax.set_xlabel("frequency [Hz]")
            ax.set_ylabel(f"{name} [({CHANNELS[name].unit})²/Hz]")
        _legend(row[0], flights)
    return sheet


def _diagnosis(names: Sequence[str], reasons: Sequence[Why | InputError]) -> Text:
    lines = []
    for name, why in zip(names, reasons, strict=True):
        if isinstance(why, InputError):
            lines.append(f"{name}: {why}")
            continue
        signs = "; ".join(f"{s.time:.2f} s {s.text}" for s in why.timeline[:4])
        cause = "nothing wrong" if why.cause == "none" else display_name(why.cause)
        lines.append(f"{name}: {cause}{': ' if signs else ''}{signs}")
    lines.append("What a model gets wrong in these flights: tombo diagnose LOG…")
    return Text(lines, "list")


def _events(names: Sequence[str], flights: Sequence[Flight]) -> list[Table]:
    rows = [
        [name, f"{event['time_s']:.2f} s", str(event.get("kind", "")), str(event.get("text", ""))]
        for name, flight in zip(names, flights, strict=True)
        for event in flight.events
        if event.get("time_s") is not None
    ]
    return [Table(["log", "time", "kind", "what"], rows)] if rows else []


def _log_data(flight: Flight, figures: Mapping[str, Any], why: Why | InputError) -> dict[str, Any]:
    judged = why if isinstance(why, Why) else None
    return {
        "log": flight.name,
        "source": flight.source,
        "figures": dict(figures),
        "cause": judged.cause if judged else None,
        "time_s": judged.time_s if judged else None,
        "findings": [finding_mapping(finding) for finding in flight.findings],
    }
