"""`diagnose_change`: from new and healthy flights of one vehicle to the change."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Flight, why_left_out
from tombo_diagnosis.change.comparison import (
    CandidateResult,
    HealthyComparison,
    compare,
    smallest_seen,
    spread_of,
)
from tombo_diagnosis.change.features import (
    AirborneFlight,
    Features,
    airborne,
    drive_samples,
    features,
    mean_of,
)
from tombo_diagnosis.change.sessions import healthy_sessions
from tombo_diagnosis.change.signatures import CENTRE, MASS, UNBALANCE, WEAK_PROPELLER, candidates
from tombo_diagnosis.change.verdict import (
    ChangeVerdict,
    judge_change,
    most_confident,
    notes,
    summary,
)
from tombo_diagnosis.change.wind import new_wind
from tombo_diagnosis.control.actuators import with_asked_rotors
from tombo_diagnosis.control.controller import ControllerReport, controller_report, with_controller
from tombo_diagnosis.diagnosis import Change, Detectable, Diagnosis, FlightSummary, Score
from tombo_diagnosis.flight.diagnose import check_flights
from tombo_diagnosis.flight.fit.drive_curve import DriveCurve, fit_drive_curve
from tombo_diagnosis.flight.nominal import NominalModel, nominal_model
from tombo_diagnosis.rotor_demand import EXPONENT
from tombo_diagnosis.wording import counted, percent
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_flight.extended_model import FittedParameter
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_logs.checks.ground import CUT_BEFORE_TAKE_OFF, rises

_SIZES: Array = np.asarray(np.geomspace(0.004, 0.5, 40), np.float64)
"""Shares of thrust and of mass that are tried."""
_EQUAL = "thrust_coefficient_error"
"""Causes that no flight distinguishes from another mass."""
NEEDED = ("position",)
"""Channels of which no flight may lack any, besides one of the commands."""
_CARRIES = 0.5
"""Share of the weight below which rotors lift no vehicle that has hardly changed."""
_REPORTED_SIZES = (MASS, *(f"{WEAK_PROPELLER}.{rotor}" for rotor in ROTOR_NAMES))
"""Candidates of which the smallest size that would be seen is told."""


@dataclass(frozen=True)
class ChangeData:
    """Data of the plot."""

    curve: DriveCurve
    healthy: tuple[Features, ...]
    new: tuple[Features, ...]


def diagnose_change(
    new: Sequence[Flight],
    healthy: Sequence[Flight],
    nominal: NominalModel,
    clock: Callable[[], float] = lambda: 0.0,
    left_out: Sequence[Finding] = (),
    sessions: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Diagnosis, ChangeData]:
    """Say what is different now on a vehicle.

    Args:
        new: flights in one new state, checked (`tombo_logs.checks`).
        healthy: flights of the same vehicle before, of more than one day if possible; checked.
        nominal: its geometry says what a weight or a weak rotor asks of the other rotors.
        clock: seconds, for the run time.
        left_out: why flights are not among these.
        sessions: pattern of flights' names -> session, where their dates are not meant.

    Raises:
        InputError: one side has no airborne flight with position and commands; new flights do not
        fly; a pattern of a session matches no flight; or the flights have no command channel in
        common.
    """
    began = clock()
    before, after, data, no_use = _read(new, healthy)
    tried = candidates(nominal.vehicle, nominal.maps, _SIZES)
    old, recent = ([f.log for f in flights] for flights in (before, after))
    named, same = healthy_sessions(old, recent, data.healthy, sessions)
    spread = spread_of(data.healthy, named, same, tried)
    curve = data.curve
    exponent_doubt, supply_doubt = curve.deviation[0] / curve.exponent, curve.deviation[1]
    comparison = compare(spread, data.new, tried, supply_doubt, exponent_doubt)
    most = most_confident(spread)
    verdict = judge_change(comparison, most)
    seen: dict[str, float] = {}
    if verdict.verdict == "none":
        seen = smallest_seen(spread, data.new, tried, supply_doubt, _REPORTED_SIZES)
    findings = (*(f for log in (*new, *healthy) for f in log.findings), *left_out, *no_use)
    shown = verdict.members if verdict.verdict in ("named", "set") else ()
    airframe = new[0].airframe
    mass, arm = nominal.vehicle.mass, nominal.vehicle.arm_length
    if airframe is not None:
        mass, arm = airframe.mass, airframe.arm_length
    changed = tuple(c for m in shown for c in _changes(m, verdict, mass, arm))
    if verdict.verdict == "named" and changed[0].effect == MASS:
        changed += (_equal(changed[0]),)
    text = summary(verdict, spread, comparison, seen)
    wind = new_wind(new, healthy)
    if wind is not None:
        changed, text = wind.change(most), wind.summary
        verdict = ChangeVerdict("named" if changed else "unknown", (), most)
    stated = "set" if any(c.effect == _EQUAL for c in changed) else verdict.verdict
    controller = _controller(new, healthy)
    diagnosis = Diagnosis(
        verdict=stated,
        causes=(),
        set=tuple(dict.fromkeys(c.label for c in changed)) if stated == "set" else (),
        separating_experiment=None,
        gain=(),
        prechecks=findings,
        candidates=_scores(comparison, seen),
        flights=tuple(_summary(f) for f in (*after, *before)),
        residuals=(),
        confidence=verdict.confidence,
        summary=with_controller(text, controller),
        notes=notes(spread, mean_of(data.new)),
        model=f"{counted(len(before), 'healthy flight')} of the same vehicle",
        vehicle=airframe.name if airframe is not None else "",
        seconds=clock() - began,
        changed=changed,
        controller=controller,
    )
    return diagnosis, data


def diagnose_change_unchecked(
    new: Sequence[Flight],
    healthy: Sequence[Flight],
    clock: Callable[[], float] = lambda: 0.0,
    sessions: Mapping[str, str] = MappingProxyType({}),
    progress: ProgressCallback = no_progress,
) -> tuple[Diagnosis, ChangeData]:
    """Check flights of both sides and compare the good ones: see `diagnose_change`.

    Raises:
        InputError: no flight of one side can be used, or as `diagnose_change`.
    """
    (after, faults), (before, more) = (
        check_flights(side, needed=NEEDED, progress=progress) for side in (new, healthy)
    )
    progress("comparing", 0.9)
    return diagnose_change(after, before, nominal_model(), clock, [*faults, *more], sessions)


def _read(
    new: Sequence[Flight], healthy: Sequence[Flight]
) -> tuple[list[AirborneFlight], list[AirborneFlight], ChangeData, tuple[Finding, ...]]:
    """Return healthy flights, new flights, their features, and why others are left out."""
    (before, no_use), (after, no_use_either) = _usable(healthy), _usable(new)
    drive = _common_drive([*before, *after])
    before, after = (
        [f if f.drive == drive else airborne(f.log, (drive,)) for f in flights]
        for flights in (before, after)
    )
    curve = fit_drive_curve([drive_samples(f) for f in before], *EXPONENT[drive])
    data = ChangeData(
        curve, tuple(features(f, curve) for f in before), tuple(features(f, curve) for f in after)
    )
    _check_fly(after, data.new)
    return before, after, data, (*no_use_either, *no_use)


def _controller(new: Sequence[Flight], healthy: Sequence[Flight]) -> ControllerReport | None:
    """Return the controller findings of the new flights, compared with the healthy flights."""
    before = controller_report(healthy, None)
    expected = () if before is None else before.gains
    return controller_report(new, None, expected, "that of the healthy flights")


def _common_drive(flights: Sequence[AirborneFlight]) -> str:
    """Return the first channel of DRIVES that every flight has, with more than 20 samples.

    Raises:
        InputError: no such channel.
    """
    for drive in DRIVES:
        if all(drive in f.log.series and f.log.series[drive].t.size > 20 for f in flights):
            return drive
    raise InputError(
        "the flights have no channel of commands in common: "
        + ", ".join(
            f"{f.log.name}: {f.drive}{why_left_out(f.log.findings, DRIVES)}" for f in flights
        )
        + f"; accepted: one of {', '.join(DRIVES)} in all of them"
    )


def _usable(logs: Sequence[Flight]) -> tuple[list[AirborneFlight], list[Finding]]:
    """Return the flights that can be compared, and why others can't.

    Raises:
        InputError: none can.
    """
    usable, refused = [], []
    for log in logs:
        try:
            usable.append(airborne(with_asked_rotors(log)))
        except InputError as error:
            refused.append(Finding("refused", "fault", log.name, str(error)))
    if not usable:
        raise InputError(refused[0].message if refused else "no flights given; accepted: some")
    return usable, refused


def _check_fly(flights: Sequence[AirborneFlight], features: Sequence[Features]) -> None:
    """Refuse flights that stay where they are with rotors that can't carry the vehicle.

    Raises:
        InputError: names the flight.
    """
    for flight, each in zip(flights, features, strict=True):
        share = float(np.mean(np.exp(each.demand)))
        if share < _CARRIES and not rises(flight.log.series["position"]):
            raise InputError(
                f"flight '{flight.log.name}': it does not fly: z stays where it is, and "
                f"{flight.drive} asks for {percent(share)} of the weight; {CUT_BEFORE_TAKE_OFF}"
            )


def _changes(
    member: CandidateResult, verdict: ChangeVerdict, mass: float, arm: float
) -> list[Change]:
    """Return the entries of the report for a candidate of the verdict: two for a pair of rotors.

    The verdict's confidence is shared out over its candidates by their probabilities.

    Args:
        member: one of `verdict.members`.
        verdict: of the comparison with healthy flights.
        mass: of the vehicle [kg]; sizes are shares of it.
        arm: from the centre to a rotor's axis [m]; offsets are shares of it.
    """
    candidate = member.candidate
    total = sum(m.probability for m in verdict.members)
    confidence = verdict.confidence * member.probability / total
    theta = _theta(member, mass, arm)
    if verdict.verdict == "named" and "+" in candidate.rotor:
        return [
            Change(candidate.effect, rotor, (part,), confidence)
            for rotor, part in zip(candidate.rotor.split("+"), theta, strict=True)
        ]
    return [Change(candidate.effect, candidate.rotor, theta, confidence)]


def _equal(mass: Change) -> Change:
    """Return the thrust change of all propellers with the same commands as a mass change."""
    (share,) = mass.theta  # a heavier vehicle needs the commands of one with less thrust
    value, high, low = (1.0 / (1.0 + x) - 1.0 for x in (share.value, share.low, share.high))
    return Change(
        _EQUAL, "", (FittedParameter("fraction", "1", 0.0, value, low, high),), mass.confidence
    )


def _theta(member: CandidateResult, mass: float, arm: float) -> tuple[FittedParameter, ...]:
    """Return the sizes of a candidate as parameters of the registry, with 95 % intervals.

    `mass` [kg] and `arm` [m] are as of `_changes`.
    """
    candidate = member.candidate
    names, unit, scale = {
        UNBALANCE: ((), "1", 1.0),
        CENTRE: (("x", "y"), "m", arm),
        WEAK_PROPELLER: (candidate.rotor.split("+"), "1", 1.0),
        MASS: (("fraction",), "1", 1.0),
    }.get(candidate.effect, (("mass",), "kg", mass))
    rows = scale * np.column_stack([member.size, member.low, member.high])
    return tuple(
        FittedParameter(name, unit, 0.0, *row)
        for name, row in zip(names, rows.tolist(), strict=True)
    )


def _scores(comparison: HealthyComparison, seen: Mapping[str, float]) -> tuple[Score, ...]:
    """Return the candidates as scores: evidence is the logarithm of the odds against no change.

    `seen`: label → smallest size that would be seen, a share; only of some.
    """
    none = max(comparison.none, 1e-300)
    return tuple(
        Score(
            f.candidate.label, math.nan,
            math.log(max(f.probability, 1e-300) / none), f.probability, True,
            detectable=Detectable("fraction", "1", size) if math.isfinite(size) else None,
        )
        for f in comparison.results
        for size in (seen.get(f.candidate.label, math.nan),)
    )  # fmt: skip


def _summary(flight: AirborneFlight) -> FlightSummary:
    log = flight.log
    return FlightSummary(
        log.name, log.source, log.duration_s, flight.used_s, flight.drive,
        tuple(c for c in ("attitude", "gyro", "accel", "voltage") if c not in log.series),
    )  # fmt: skip
