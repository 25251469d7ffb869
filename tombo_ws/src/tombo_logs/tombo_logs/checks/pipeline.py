"""All checks of a flight, in their order."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from tombo_bag.channels import DRIVES, ROTOR_SPEEDS
from tombo_bag.flight import Finding, Flight, RefusedLog, Series, why_left_out
from tombo_dynamics.arrays import Array
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks import coverage, events, imu, poses, samples
from tombo_logs.checks.clocks.clock_offsets import one_clock
from tombo_logs.checks.clocks.clock_rates import common_clock
from tombo_logs.checks.clocks.stamps import (
    arrival_stamps,
    check_pose_rate,
    gaps,
    no_common_time,
    other_units,
)
from tombo_logs.checks.even_flight import EvenFlight, poses_and_imu
from tombo_logs.checks.ground import check_flies, ground, motor_drive, rises
from tombo_logs.checks.rotors import motors, rotor_order
from tombo_logs.checks.rotors.motors import Hover
from tombo_logs.checks.spans import Mask, Span, inside, merged
from tombo_logs.checks.wind import wind

POSE = ("position", "attitude")
_IMU = ("gyro", "accel")
_MOVING = (*POSE, *_IMU, "rotor_speed", "motor_command")
"""Channels that never stand still or follow a line in flight."""
_LEAST = 10
_STEADY = 1e-6
"""Range of a command over its size below which it never changes."""
_LEAST_COMMANDS = 50
_NEAR_GROUND_S = 1.0
"""s around what is set apart in which rotors may turn slowly."""
_SET_APART = {"crash", "contact", "jump", "ground", "frozen"}
"""Checks whose spans are not diagnosed."""


def check_log(log: Flight, hover: Hover | None = None, needed: Sequence[str] = POSE) -> Flight:
    """Return a flight with cleaned channels, findings, and excluded spans.

    Channels that can't be used are taken out; a second call changes nothing.

    Args:
        log: as read.
        hover: how the vehicle of the nominal model hovers (`rotors.motors.hover_of`), to see that
            it is the vehicle that flew; None, or a log with an airframe of its own: not checked.
        needed: channels without which the flight can't be used, position at least. Without an
            attitude, what would be compared with it is not checked.

    Raises:
        RefusedLog: a channel that is needed is missing or can't be used, the vehicle does not fly,
            or another vehicle flew.
    """
    series, findings = recorded(log)
    if "position" in series:
        series["position"], more = samples.without_wrong_poses(log.name, series["position"])
        findings += more
    _check_there(log.name, series, findings, needed)
    poses.check_values(log.name, series)
    flown = float(series["position"].t[0]), float(series["position"].t[-1])
    stood_still = [
        finding
        for name in _MOVING
        if name in series
        for finding in samples.unmeasured(log.name, name, series[name])
    ]
    lost = _spans(f for f in stood_still if f.channel in POSE)
    position = series["position"]
    keep = ~inside(position.t, lost)
    seen = Series(position.t[keep], position.values[keep]) if keep.any() else position
    check_flies(log.name, position, series)
    poses.check_height(log.name, position, motor_drive(position.t, series))
    findings += ground(log.name, seen, series)
    down = _spans(f for f in findings if f.check == "ground")
    # motors stand still on the ground, and before the first pose
    findings += [
        f
        for f in stood_still
        if not any(b <= max(f.start_s, flown[0]) and min(f.end_s, flown[1]) <= e for b, e in down)
    ]
    findings += _accel_unit(log.name, series, down)
    known = [*log.exclude, *_spans(findings)]
    motion = _motion(series, known)
    if motion is not None:
        poses.check_tilt(log.name, motion)
    findings += _rotor_sensors(log.name, series, known, flown)
    set_back = {f.channel for f in findings if f.check == "stamps" and f.severity == "fault"}
    if motion is not None:
        series, more = common_clock(log.name, series, motion, frozenset(set_back))
        findings += more
    uncovered, more = _limit_spans(log.name, series, flown, down)
    findings += more
    excluded = [*log.exclude, *uncovered]
    motion = _motion(series, [*excluded, *_spans(findings)])
    findings += _impacts(log.name, series, motion, findings)
    apart = merged([*excluded, *_spans(findings)])
    series, more = _consistent(log.name, series, apart)
    findings += more
    if (motion := _motion(series, apart)) is not None:
        known_vehicle = log.airframe or hover
        mass = None if known_vehicle is None else known_vehicle.mass
        findings += wind(log.name, motion, series["position"], mass)
    findings += _motors(log.name, series, apart, None if log.airframe is not None else hover)
    position = series["position"]
    findings += arrival_stamps(log.name, position.t, position.arrival)
    for name, s in series.items():
        if name not in ("voltage", "current", "rotor_command", "attitude"):
            findings += gaps(log.name, name, s.t)
    findings += coverage.absent(log.name, series)
    findings += coverage.share_set_apart(log.name, position, apart)
    kept = [f for f in dict.fromkeys(findings) if f not in log.findings]
    return dataclasses.replace(
        log.with_series(series), findings=(*log.findings, *kept), exclude=tuple(apart)
    )


def findings_of(log: Flight) -> tuple[Finding, ...]:
    """Return what checks find in a log, whatever it is of; the last one says if they refuse it."""
    try:
        return check_log(log, needed=("position",)).findings
    except RefusedLog as error:
        return (*log.findings, error.finding)


def recorded(log: Flight) -> tuple[dict[str, Series], list[Finding]]:
    """Return the usable channels, cleaned and on one clock, and the findings.

    Every reader of a flight needs that: one body, one clock, possible values. The search for the
    cause of a crash, to which the checks of the motion do not apply, begins with it, too.

    Raises:
        RefusedLog: the poses are those of several bodies, or their stamps are in no known unit.
    """
    position = log.series.get("position")
    apart = 0.0 if position is None else bodies_apart(position.values)
    if apart > 0.0:
        raise RefusedLog(
            log.name,
            "position",
            f"position: poses of two bodies or more take turns in one topic, {apart:.2f} m apart; "
            "accepted: one body; is the topic published twice?",
            "bodies",
        )
    series: dict[str, Series] = {}
    findings: list[Finding] = []
    for name, raw in log.series.items():
        clean, more = samples.clean_series(log.name, name, raw)
        findings += more
        if samples.nothing_left(clean):
            text = f"{name}: {raw.t.size} samples, {clean.t.size} of them usable; left out"
            findings.append(Finding("missing", "fault", log.name, text, channel=name))
        else:
            series[name] = clean
    for name in DRIVES:
        findings += _drop_faulty(
            series, _drive(log.name, name, series[name]) if name in series else []
        )
    if "position" not in series:
        return series, findings
    check_pose_rate(log.name, series)
    findings += _drop_faulty(series, other_units(log.name, series))
    series, more = one_clock(log.name, series)
    return series, [*findings, *more, *_drop_faulty(series, no_common_time(log.name, series))]


def _drop_faulty(series: dict[str, Series], findings: list[Finding]) -> list[Finding]:
    """Take channels with a fault out of `series`; returns the findings."""
    for f in findings:
        if f.severity == "fault":
            series.pop(f.channel, None)
    return findings


def _drive(flight: str, name: str, drive: Series) -> list[Finding]:
    """Report drives that say nothing of the rotors: constant throughout."""
    values = drive.values
    size = float(np.median(np.abs(values)))
    if len(values) >= _LEAST_COMMANDS and np.ptp(values, axis=0).max() <= _STEADY * max(size, 1.0):
        text = (
            f"{name}: {float(np.median(values)):.4g} throughout; expected: commands that hold a "
            "vehicle in the air; another output, or not recorded; left out"
        )
        return [Finding("frozen", "fault", flight, text, channel=name, key="constant")]
    return []


def _check_there(
    flight: str, series: dict[str, Series], findings: list[Finding], needed: Sequence[str]
) -> None:
    for name in needed:
        count = series[name].t.size if name in series else 0
        if count < _LEAST:
            raise RefusedLog(
                flight,
                name,
                f"no usable {name}: {count} samples{why_left_out(findings, (name,))}; needed: "
                f"{' and '.join(needed)} of the motion capture, at least {_LEAST} samples",
            )


def _limit_spans(
    flight: str, series: dict[str, Series], flown: Span, down: list[Span]
) -> tuple[list[Span], list[Finding]]:
    """Return the spans in which a channel is not there or at its limit, and findings.

    Channels of which too little is left are taken out.
    """
    out, findings, apart = coverage.parts(flight, series, flown, down)
    for name in out:
        del series[name]
    for name in _IMU:
        if name in series:
            flying = _flying(series[name], down)
            spans, limited = samples.limit_spans(flight, name, series[name], flying)
            findings += limited
            apart += spans or []
            if spans is None:
                del series[name]
    return apart, findings


def _spans(findings: Iterable[Finding]) -> list[Span]:
    return [
        (f.start_s, f.end_s)
        for f in findings
        if f.check in _SET_APART and np.isfinite(f.start_s) and np.isfinite(f.end_s)
    ]


def _motion(series: dict[str, Series], apart: list[Span]) -> EvenFlight | None:
    """Return the motion by poses and IMU; None: the attitude is not known."""
    if "attitude" not in series:
        return None
    return poses_and_imu(
        series["position"], series["attitude"], series.get("gyro"), series.get("accel"), apart
    )


def _impacts(
    flight: str, series: dict[str, Series], motion: EvenFlight | None, findings: list[Finding]
) -> list[Finding]:
    down = [(f.start_s, f.end_s) for f in findings if f.check == "ground"]
    times = series["position"].t
    candidates = events.pose_events(series["position"], series.get("attitude"))
    if "attitude" in series:
        candidates += events.tilt_events(series["attitude"])
    gravity = np.array([0.0, 0.0, GRAVITY])
    seen: Array = np.zeros(0)
    force: Array = np.zeros(0)
    if motion is not None:
        seen, force = motion.t, np.linalg.norm(motion.acceleration + gravity, axis=1)
    if "accel" in series:
        candidates += events.accel_events(series["accel"], seen, force)
    elif "acceleration" in series:
        felt = series["acceleration"]
        candidates += events.accel_events(Series(felt.t, felt.values + gravity), seen, force)
    if "gyro" in series:
        candidates += events.gyro_events(series["gyro"])
    lines = [f for f in findings if f.check == "frozen" and f.channel in _IMU]
    drawn = inside(np.array([e.t for e in candidates]), [(f.start_s, f.end_s) for f in lines])
    on_lines = [e for e, d in zip(candidates, drawn, strict=True) if d]
    real = [e for e, d in zip(candidates, drawn, strict=True) if not d]
    return [
        *events.unmeasured(flight, on_lines, lines),
        *events.impacts(flight, real, down, (times[0], times[-1]), series),
    ]


def _consistent(
    flight: str, series: dict[str, Series], apart: list[Span]
) -> tuple[dict[str, Series], list[Finding]]:
    """Compare poses, gyro and accelerometer; leave out what contradicts."""
    motion = _motion(series, apart)
    if motion is None:
        return series, []
    findings, scale = imu.check_gyro(flight, motion)
    wrong = any(f.severity == "fault" for f in findings)
    poses.check_poses(flight, motion, scale, imu=not wrong)
    if not wrong:
        axes = imu.check_accel_axes(flight, motion)
        wrong = bool(axes)
        findings += axes or (imu.accel_offsets(flight, motion) or imu.track_scales(flight, motion))
    if wrong:
        series = {name: s for name, s in series.items() if name not in _IMU}
    return series, findings


def _accel_unit(flight: str, series: dict[str, Series], down: list[Span]) -> list[Finding]:
    """Check unit and upward axis of the accelerometer; a faulty IMU is taken out."""
    if "accel" not in series:
        return []
    accel = series["accel"]
    findings = imu.check_accel(flight, accel, _flying(accel, down))
    if findings:
        for name in _IMU:
            series.pop(name, None)
    return findings


def _rotor_sensors(
    flight: str, series: dict[str, Series], apart: list[Span], flown: Span
) -> list[Finding]:
    """Check each rotor's speed; unusable samples are removed."""
    if "rotor_speed" not in series:
        return []
    speed = series.pop("rotor_speed")
    # its clock and that of the poses may differ: not close to take-off and landing
    wide = [(b - _NEAR_GROUND_S, e + _NEAR_GROUND_S) for b, e in apart]
    flying = _flying(speed, wide) & inside(speed.t, [flown])
    replaced = any(name in series for name in DRIVES)
    kept, findings = motors.sensor_faults(
        flight, speed, series.get("rotor_command"), flying, replaced
    )
    if kept is not None:
        series["rotor_speed"] = kept
    return findings


def _motors(
    flight: str, series: dict[str, Series], apart: list[Span], hover: Hover | None
) -> list[Finding]:
    findings: list[Finding] = []
    for name in ("motor_command", "rotor_command"):
        if name in series:
            flying = _flying(series[name], apart)
            findings += motors.saturation(flight, name, series[name], flying)
            findings += motors.rotor_scales(flight, name, series[name], flying)
    if "motor_command" in series:
        command = series["motor_command"]
        faults = motors.range_of(flight, command, _flying(command, apart))
        findings += _drop_faulty(series, faults)
    for name in DRIVES:
        if name in series and "gyro" in series:
            faults = rotor_order.rotor_order(flight, name, series[name], series["gyro"], apart)
            faults = faults or rotor_order.command_delay(
                flight, name, series[name], series["gyro"], apart
            )
            findings += _drop_faulty(series, faults)
    if "rotor_speed" in series and "rotor_command" in series:
        speed = series["rotor_speed"]
        flying = _flying(speed, apart)
        faults = motors.speed_against_command(flight, speed, series["rotor_command"], flying)
        findings += _drop_faulty(series, faults)
    if hover is not None:
        drives: dict[str, tuple[Series, Mask]] = {
            name: (series[name], _flying(series[name], apart))
            for name in ROTOR_SPEEDS
            if name in series
        }
        rose = rises(series["position"])
        findings += _drop_faulty(series, motors.check_vehicle(flight, drives, hover, rose))
    return findings


def _flying(series: Series, apart: list[Span]) -> Mask:
    return ~inside(series.t, apart)
