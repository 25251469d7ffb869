"""`diagnose_flights`: measured flights and a nominal model in, a `Diagnosis` out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Flight
from tombo_diagnosis.control.controller import ControllerReport, controller_report, with_controller
from tombo_diagnosis.control.signals import DrivePlant
from tombo_diagnosis.diagnosis import Diagnosis, FlightSummary, Residual
from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.engine.verdict import separating_experiment
from tombo_diagnosis.flight.analyse import UNCERTAIN_VERDICTS, FlightAnalysis, analyse
from tombo_diagnosis.flight.calibrate import calibrated, has_no_thrust_data, thrust_from_track
from tombo_diagnosis.flight.causes import UNWEIGHED, estimate_cause, scores, shown_by_scale
from tombo_diagnosis.flight.cross_validation import (
    extended,
    gain_by_effect,
    nominal_residuals,
    refuse_contradicted,
)
from tombo_diagnosis.flight.fit.prediction import motion_of
from tombo_diagnosis.flight.fit.track import Track, track_of
from tombo_diagnosis.flight.leftover import flight_leftover
from tombo_diagnosis.flight.nominal import (
    NominalModel,
    held_against,
    nominal_model,
    nominal_tolerances,
)
from tombo_diagnosis.flight.summary_text import notes, summary
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import Model, read_model
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.vehicle_file import read_vehicle
from tombo_logs.checks import check_log
from tombo_logs.checks.pipeline import POSE
from tombo_logs.checks.rotors.motors import Hover, hover_of
from tombo_logs.readers.log_reader import read_logs
from tombo_logs.readers.vehicle_airframe import vehicle_of

_BLOCK_S = 8.0
"""A single flight is cut into blocks of about this length, which count as flights."""
_MIN_NOISE = 1e-9
"""A simulated noise below this is rounding, in any unit."""
_MAX_FLIGHTS_SHOWN = 8
"""Flights whose residuals go into the report."""


def diagnose_flights(
    logs: Sequence[Flight],
    nominal: NominalModel,
    progress: ProgressCallback = no_progress,
    clock: Callable[[], float] = lambda: 0.0,
    left_out: Sequence[Finding] = (),
) -> tuple[Diagnosis, FlightAnalysis]:
    """Report the errors of the model in measured flights, with the analysis behind the report.

    Args:
        logs: flights of one vehicle, checked (`tombo_logs.checks`).
        nominal: the model; of a vehicle that is not the suite's own one is made from the flights.
        progress: called with a stage and the share done.
        clock: seconds, for the run time.
        left_out: why flights are not among `logs`.

    Raises:
        InputError: no flight that can be used; says why.
    """
    began = clock()
    usable, unusable = _usable(logs)
    controller = _controller(usable, nominal)
    frame = usable[0].airframe
    driven = any(set(DRIVES) & set(log.series) for log in usable)
    if frame is not None and not driven and all(log.airframe == frame for log in usable):
        nominal = replace(nominal_model(vehicle=vehicle_of(frame)), calibrated=True)
    elif any(log.airframe is not None for log in usable):
        nominal, usable = calibrated(usable)
    if all(has_no_thrust_data(log) for log in usable):
        nominal, usable = thrust_from_track(usable, nominal)
    tracks = _blocks([track_of(log) for log in usable])
    findings = analyse(tracks, nominal, progress)
    progress("measuring the gain", 0.7)
    findings, final, gains, refused = refuse_contradicted(findings)
    problem, search, judgement = findings.problem, findings.search, findings.judgement
    causes = tuple(
        estimate_cause(e, findings, final if e in final.effects else search.explaining(e))
        for e in judgement.effects
    )
    leftover = None
    if judgement.verdict in UNCERTAIN_VERDICTS:
        leftover = flight_leftover(problem, final.fit, findings.remainder.unexplained_groups)
    vehicle = problem.nominal.vehicle
    unweighed = any(not shown_by_scale(c.effect, c.theta, vehicle) for c in causes)
    progress("done", 1.0)
    diagnosis = Diagnosis(
        verdict=judgement.verdict,
        causes=causes,
        set=judgement.members,
        separating_experiment=separating_experiment(judgement.members, REGISTRY),
        gain=tuple(gains),
        prechecks=(
            *(f for log in logs for f in log.findings),
            *left_out,
            *unusable,
            *findings.remainder.excluded,
        ),
        candidates=scores(findings, gain_by_effect(problem, search), refused),
        flights=tuple(
            FlightSummary(
                t.name, t.log.source, t.log.duration_s, t.used_s, t.formulation, t.missing
            )
            for t in problem.tracks
        ),
        residuals=tuple(_residuals(findings, final)),
        confidence=min(judgement.confidence, UNWEIGHED) if unweighed else judgement.confidence,
        summary=with_controller(summary(findings, causes, gains), controller),
        notes=tuple(notes(findings)),
        model=nominal.label,
        vehicle=nominal.vehicle_name
        or (usable[0].airframe.name if usable[0].airframe is not None else ""),
        seconds=clock() - began,
        leftover=leftover,
        controller=controller,
        tolerances=nominal_tolerances(nominal),
    )
    return diagnosis, findings


def _usable(logs: Sequence[Flight]) -> tuple[list[Flight], list[Finding]]:
    """Return the flights that can be used, and why others can't."""
    usable, refused = [], []
    for log in logs:
        try:
            track_of(log)
        except InputError as error:
            refused.append(Finding("missing", "fault", log.name, str(error)))
        else:
            usable.append(log)
    if not usable:
        none = "no flights given; accepted: one or more"
        raise InputError(refused[0].message if refused else none)
    kinds = {tuple(sorted(set(log.series) & {"accel", "gyro"})) for log in usable}
    if len(kinds) > 1:
        whole = [log for log in usable if {"accel", "gyro"} <= set(log.series)]
        refused += _unlike(usable, whole, "no IMU")
        usable = whole or usable
    driven = [log for log in usable if set(DRIVES) & set(log.series)]
    if driven and usable[0].airframe is not None:  # thrust is fitted to what drives the rotors
        refused += _unlike(usable, driven, "no motor commands")
        usable = driven
    return usable, refused


def _unlike(logs: Sequence[Flight], kept: Sequence[Flight], lack: str) -> list[Finding]:
    """Return why logs that are not among those kept are left out."""
    used = {id(log) for log in kept}
    return [
        Finding("missing", "warning", log.name, f"{lack}, unlike the others: left out")
        for log in logs
        if id(log) not in used
    ]


def _blocks(tracks: list[Track]) -> list[Track]:
    """Return a single flight as blocks that are held out in turn; several flights as they are."""
    if len(tracks) > 1:
        return tracks
    track = tracks[0]
    count = int(np.clip(track.used_s // _BLOCK_S, 1, 6))
    if count < 2:
        return tracks
    edges = np.quantile(track.times("slow"), np.linspace(0.0, 1.0, count + 1))
    edges[-1] += 1.0
    parts = []
    for k, (begin, end) in enumerate(pairwise(edges)):
        stamps = (track.fast.t, track.slow.t, track.pose_t)
        part = track.only(*((t >= begin) & (t < end) for t in stamps))
        parts.append(replace(part, name=f"{track.name} part {k + 1}"))
    return parts


def _residuals(findings: FlightAnalysis, final: Explanation) -> list[Residual]:
    """Return the residuals before and after, with their possible drivers."""
    problem = findings.problem
    sigma = _noise(findings)
    shown = []
    for f in range(min(len(problem.tracks), _MAX_FLIGHTS_SHOWN)):
        track = problem.tracks[f]
        motion = motion_of(track, problem.nominal, problem.theta)
        after = extended(problem, final.fit, f)
        body = np.einsum("nji,nj->ni", motion.rotation, motion.state[:, 3:6])
        drivers = {f"body_velocity_{a} [m/s]": body[:, i] for i, a in enumerate("xyz")}
        drivers["speed [m/s]"] = np.linalg.norm(body, axis=1)
        drivers["height [m]"] = motion.state[:, 2]
        drivers |= {f"body_rate_{a} [rad/s]": motion.state[:, 10 + i] for i, a in enumerate("xyz")}
        if track.command.size:
            drivers["mean_rotor_command [rad/s]"] = track.command.mean(axis=1)
        if track.voltage.size:
            drivers["voltage [V]"] = track.voltage[:, 0]
        for group, rows in nominal_residuals(problem, f).items():
            at = track.times(group)
            beside = {n: np.interp(at, track.t, v) for n, v in drivers.items()}
            shown += [
                Residual(
                    track.name, c.name, c.unit, at, old, new, sigma.get(c.name, math.nan), beside
                )
                for c, old, new in zip(
                    problem.channels[f][group], rows.T, after[group].T, strict=True
                )
            ]
    return shown


def _controller(logs: Sequence[Flight], nominal: NominalModel) -> ControllerReport | None:
    own = all(log.airframe is None for log in logs)
    plant = DrivePlant(nominal.vehicle, nominal.maps, nominal.maps.torque_ratio) if own else None
    return controller_report(logs, plant)


def _noise(findings: FlightAnalysis) -> dict[str, float]:
    """Return channel -> standard deviation that noise alone gives it, where it is known.

    Of a vehicle whose healthy flights are not known it is not; nor of a channel that the
    simulated noise does not reach.
    """
    expected = findings.remainder.expected
    if findings.problem.nominal.calibrated:
        return {}
    deviations = {
        name: math.sqrt(2.0 * float(expected.variances[0, j]))
        for j, name in enumerate(expected.names)
    }
    return {name: sigma for name, sigma in deviations.items() if sigma > _MIN_NOISE}


def check_flights(
    flights: Sequence[Flight],
    hover: Hover | None = None,
    needed: Sequence[str] = POSE,
    progress: ProgressCallback = no_progress,
) -> tuple[list[Flight], list[Finding]]:
    """Return the flights that pass `check_log`, checked, and why others are left out.

    Raises:
        InputError: no flight is left; why the first is not.
    """
    checked, refused = [], []
    first: InputError | None = None
    for k, flight in enumerate(flights):
        progress(f"checking {flight.name}", k / len(flights))
        try:
            checked.append(check_log(flight, hover, needed))
        except InputError as error:
            refused.append(Finding("refused", "fault", flight.name, str(error)))
            first = first or error
    if first is not None and not checked:
        raise first
    return checked, refused


def diagnose_unchecked(
    flights: Sequence[Flight],
    nominal: NominalModel,
    progress: ProgressCallback = no_progress,
    clock: Callable[[], float] = lambda: 0.0,
) -> tuple[Diagnosis, FlightAnalysis]:
    """Check flights and diagnose the good ones: see `check_flights`, `diagnose_flights`."""
    hover = hover_of(nominal.label, nominal.vehicle, nominal.maps)
    checked, refused = check_flights(flights, hover, progress=progress)
    return diagnose_flights(checked, nominal, progress, clock, refused)


def diagnose_logs(
    logs: Sequence[Path],
    model: Path | None,
    mapping: str | None,
    names: Mapping[str, str],
    vehicle: str | None,
    clock: Callable[[], float],
    on_progress: ProgressCallback = no_progress,
) -> tuple[Diagnosis, str, Model | None]:
    """Read, check and diagnose flights.

    Args:
        logs: files or folders.
        model: a model.yaml that the flights are compared with.
        mapping: file, or name of a shipped one.
        names: topic as recorded → name in this suite.
        vehicle: name or file of the vehicle that flew.
        clock: returns the time [s], for the run time.
        on_progress: called with the progress.

    Returns:
        The diagnosis, the name of the reference vehicle, and the model given.

    Raises:
        InputError: a log, the mapping, the vehicle or the model can't be used.
    """
    base = None if model is None else read_model(model)
    nominal = nominal_model(model, vehicle)
    on_progress(f"reading {logs[0].name}{' and others' if len(logs) > 1 else ''}", 0.0)
    flights = read_logs(logs, mapping=mapping, names=names)
    if vehicle is not None:
        flights = held_against(flights, read_vehicle(vehicle))
    diagnosis, _ = diagnose_unchecked(flights, nominal, on_progress, clock)
    return diagnosis, nominal.label, base
