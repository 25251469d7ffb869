"""All checks of a flight, in their order."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from tombo_diagnosis.checks import events, frozen_values, impacts, imu, motors, poses, rotor_order
from tombo_diagnosis.checks.change_points import changes
from tombo_diagnosis.checks.gaps import gaps
from tombo_diagnosis.checks.ground import ground
from tombo_diagnosis.checks.motion import Motion, motion_of
from tombo_diagnosis.checks.series_cleaning import clean_series, nothing_left
from tombo_diagnosis.checks.spans import Mask, Span, block_means, inside, merged, sample_interval
from tombo_diagnosis.checks.timestamps import arrival_stamps
from tombo_diagnosis.logs.flight_log import Finding, FlightLog, Series
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY

POSE = ("position", "attitude")
_IMU = ("gyro", "accel")
_MOVING = (*POSE, *_IMU, "rotor_speed", "motor_command")
"""Channels that never stand still or follow a line in flight."""
_LEAST = 10
_SET_APART = {"crash", "contact", "jump", "ground", "frozen"}
"""Checks whose spans are not diagnosed."""


def check_log(log: FlightLog) -> FlightLog:
    """Return a flight with cleaned channels, findings, and excluded spans.

    Channels that can't be used are taken out; a second call changes nothing.

    Raises:
        InputError: position or attitude is missing or can't be used.
    """
    series, findings = _tidy(log)
    for name in POSE:
        if name not in series:
            why = "; ".join(f.message for f in findings if f.channel == name)
            raise InputError(
                f"flight '{log.name}': no usable {name}{f' ({why})' if why else ''}; needed: "
                "position and attitude of the motion capture"
            )
        if series[name].t.size < _LEAST:
            raise InputError(
                f"flight '{log.name}': {name}: {series[name].t.size} samples; needed: at least "
                f"{_LEAST}, and seconds of flight for a diagnosis"
            )
    poses.check_attitude(log.name, series["attitude"])
    poses.check_height(log.name, series["position"])
    begin, end = series["position"].t[0], series["position"].t[-1]
    stood_still = _stuck(log.name, series)
    lost = _spans(f for f in stood_still if f.channel in POSE)
    position = series["position"]
    keep = ~inside(position.t, lost)
    seen = Series(position.t[keep], position.values[keep]) if keep.any() else position
    findings += ground(log.name, seen, series)
    down = _spans(f for f in findings if f.check == "ground")
    # motors stand still on the ground
    findings += [
        f for f in stood_still if not any(b <= f.start_s and f.end_s <= e for b, e in down)
    ]
    apart = [*log.exclude, *_spans(findings)]
    motion = _motion(series, apart)
    poses.check_tilt(log.name, motion)
    findings += _impacts(log.name, series, motion, findings)
    apart = merged([*log.exclude, *_spans(findings)])
    series, found = _held_together(log.name, series, apart)
    findings += found
    findings += _motors(log.name, series, apart)
    findings += _changes(log.name, series, apart)
    position = series["position"]
    findings += arrival_stamps(log.name, position.t, position.arrival)
    for name, s in series.items():
        if name not in ("voltage", "current", "rotor_command", "attitude"):
            findings += gaps(log.name, name, s.t, begin, end)
    kept = [f for f in findings if f not in log.findings]
    return dataclasses.replace(
        log, series=series, findings=(*log.findings, *kept), exclude=tuple(apart)
    )


def _tidy(log: FlightLog) -> tuple[dict[str, Series], list[Finding]]:
    series: dict[str, Series] = {}
    findings: list[Finding] = []
    for name, raw in log.series.items():
        clean, found = clean_series(log.name, name, raw)
        findings += found
        if nothing_left(clean):
            text = f"{name}: {raw.t.size} samples, {clean.t.size} of them usable; left out"
            findings.append(Finding("missing", "warning", log.name, text, channel=name))
        else:
            series[name] = clean
    return series, findings


def _stuck(flight: str, series: dict[str, Series]) -> list[Finding]:
    found: list[Finding] = []
    for name in _MOVING:
        if name in series:
            values = series[name].t, series[name].values
            found += frozen_values.frozen(flight, name, *values)
            found += frozen_values.drawn(flight, name, *values)
    return found


def _spans(findings: Iterable[Finding]) -> list[Span]:
    return [
        (f.start_s, f.end_s)
        for f in findings
        if f.check in _SET_APART and np.isfinite(f.start_s) and np.isfinite(f.end_s)
    ]


def _motion(series: dict[str, Series], apart: list[Span]) -> Motion:
    return motion_of(
        series["position"], series["attitude"], series.get("gyro"), series.get("accel"), apart
    )


def _impacts(
    flight: str, series: dict[str, Series], motion: Motion, findings: list[Finding]
) -> list[Finding]:
    down = [(f.start_s, f.end_s) for f in findings if f.check == "ground"]
    times = series["position"].t
    found = events.pose_events(series["position"], series["attitude"])
    found += events.tilt_events(series["attitude"])
    if "accel" in series:
        force = np.linalg.norm(motion.acceleration + np.array([0.0, 0.0, GRAVITY]), axis=1)
        found += events.accel_events(series["accel"], motion.t, force)
    if "gyro" in series:
        found += events.gyro_events(series["gyro"])
    lines = [f for f in findings if f.check == "frozen" and f.channel in _IMU]
    drawn = inside(np.array([e.t for e in found]), [(f.start_s, f.end_s) for f in lines])
    on_lines = [e for e, d in zip(found, drawn, strict=True) if d]
    real = [e for e, d in zip(found, drawn, strict=True) if not d]
    return [
        *impacts.unmeasured(flight, on_lines, lines),
        *impacts.impacts(flight, real, down, (times[0], times[-1]), series),
    ]


def _held_together(
    flight: str, series: dict[str, Series], apart: list[Span]
) -> tuple[dict[str, Series], list[Finding]]:
    """Compare poses, gyro and accelerometer; leave out what contradicts."""
    findings: list[Finding] = []
    if "accel" in series:
        accel = series["accel"]
        findings += imu.check_accel(flight, accel, _flying(accel, apart))
    motion = _motion(series, apart)
    found, scale = imu.check_gyro(flight, motion)
    findings += found
    wrong = any(f.severity == "fault" for f in findings)
    poses.check_poses(flight, motion, scale, imu=not wrong)
    if wrong:
        series = {name: s for name, s in series.items() if name not in _IMU}
    return series, findings


def _motors(flight: str, series: dict[str, Series], apart: list[Span]) -> list[Finding]:
    findings: list[Finding] = []
    for name in ("motor_command", "rotor_command"):
        if name in series:
            flying = _flying(series[name], apart)
            findings += motors.saturation(flight, name, series[name], flying)
    if "motor_command" in series:
        command = series["motor_command"]
        found = motors.range_of(flight, command, _flying(command, apart))
        if found:
            del series["motor_command"]
        findings += found
    for name in ("rotor_speed", "rotor_command", "motor_command"):
        if name in series and "gyro" in series:
            found = rotor_order.rotor_order(flight, name, series[name], series["gyro"], apart)
            if found:
                del series[name]
            findings += found
    if "rotor_speed" in series and "rotor_command" in series:
        speed = series["rotor_speed"]
        flying = _flying(speed, apart)
        found = motors.speed_against_command(flight, speed, series["rotor_command"], flying)
        if any(f.severity == "fault" for f in found):
            del series["rotor_speed"]
        findings += found
    return findings


def _changes(flight: str, series: dict[str, Series], apart: list[Span]) -> list[Finding]:
    drivers = [n for n in ("rotor_speed", "rotor_command", "motor_command") if n in series]
    if "accel" not in series or not drivers:
        return []
    accel, drive = series["accel"], series[drivers[0]]
    every = max(round(0.02 / max(sample_interval(accel.t), 1e-6)), 1)  # 20 ms
    t, force = block_means(accel.t, every), block_means(accel.values[:, 2], every)
    asked = np.interp(t, drive.t, np.mean(drive.values**2, axis=1))
    rows = ~inside(t, apart) & (t >= drive.t[0]) & (t <= drive.t[-1])
    return changes(flight, t[rows], force[rows], asked[rows])


def _flying(series: Series, apart: list[Span]) -> Mask:
    return ~inside(series.t, apart)
