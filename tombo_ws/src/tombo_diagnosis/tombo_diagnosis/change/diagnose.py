"""`diagnose_change`: new flights and healthy flights of one vehicle in, what has changed out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.change.comparison import Comparison, Finding, compare, mean_of, spread_of
from tombo_diagnosis.change.features import (
    EXPONENT,
    AirborneFlight,
    Features,
    airborne,
    drive_samples,
    features,
)
from tombo_diagnosis.change.signatures import (
    CENTRE,
    MASS,
    UNBALANCE,
    WEAK_PROPELLER,
    candidates,
    centre_directions,
)
from tombo_diagnosis.change.summary_text import notes, summary
from tombo_diagnosis.change.verdict import ChangeVerdict, judge_change
from tombo_diagnosis.diagnosis import Change, Diagnosis, FlightSummary, Score
from tombo_diagnosis.flight.fit.drive_curve import DriveCurve, fit_drive_curve
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import FittedParameter
from tombo_logs.flight_log import DRIVES, FlightLog

_SIZES: Array = np.asarray(np.geomspace(0.004, 0.5, 40), np.float64)
"""Shares of thrust and of mass that are tried."""
_EQUAL = "thrust_coefficient_error"
"""What no flight tells from another mass."""


@dataclass(frozen=True)
class ChangeData:
    """What the plot needs."""

    curve: DriveCurve
    healthy: tuple[Features, ...]
    new: tuple[Features, ...]


def diagnose_change(
    new: Sequence[FlightLog],
    healthy: Sequence[FlightLog],
    nominal: NominalModel,
    clock: Callable[[], float] = lambda: 0.0,
) -> tuple[Diagnosis, ChangeData]:
    """Say what is different now on a vehicle.

    Args:
        new: flights in one new state.
        healthy: flights of the same vehicle before, of more than one day if possible.
        nominal: its geometry says what a weight or a weak rotor asks of the other rotors.
        clock: seconds, for the run time.

    Raises:
        InputError: a flight has no position, no commands, is never in the air, or the flights have
            no channel of commands in common.
    """
    began = clock()
    before, after = [airborne(f) for f in healthy], [airborne(f) for f in new]
    drive = _common_drive([*before, *after])
    before, after = ([_with_drive(f, drive) for f in flights] for flights in (before, after))
    curve = fit_drive_curve([drive_samples(f) for f in before], EXPONENT[drive])
    data = ChangeData(
        curve, tuple(features(f, curve) for f in before), tuple(features(f, curve) for f in after)
    )
    tried = candidates(nominal.vehicle, nominal.maps, _SIZES)
    centre = centre_directions(nominal.vehicle, nominal.maps)
    spread = spread_of(data.healthy)
    comparison = compare(spread, data.new, tried, centre, curve.deviation[1])
    verdict = judge_change(comparison, len(healthy))
    shown = verdict.members if verdict.verdict in ("named", "set") else ()
    airframe = new[0].airframe
    mass, arm = nominal.vehicle.mass, nominal.vehicle.arm_length
    if airframe is not None:
        mass, arm = airframe.mass, airframe.arm_length
    changed = tuple(c for m in shown for c in _changes(m, verdict, mass, arm))
    # a named mass is a set with what no flight tells from it
    said = "set" if any(c.effect == _EQUAL for c in changed) else verdict.verdict
    diagnosis = Diagnosis(
        verdict=said,
        causes=(),
        set=tuple(dict.fromkeys(_label(c) for c in changed)) if said == "set" else (),
        separating_experiment=None,
        gain=(),
        prechecks=tuple(f for flight in (*after, *before) for f in flight.findings),
        candidates=_scores(comparison),
        flights=tuple(_summary(f) for f in (*after, *before)),
        residuals=(),
        confidence=verdict.confidence,
        summary=summary(verdict, spread, comparison),
        notes=notes(spread, mean_of(data.new)),
        model=f"{len(healthy)} healthy flight{'s' * (len(healthy) > 1)} of the same vehicle",
        vehicle=airframe.name if airframe is not None else "",
        seconds=clock() - began,
        changed=changed,
    )
    return diagnosis, data


def _label(change: Change) -> str:
    return f"{change.effect}.{change.rotor}" if change.rotor else change.effect


def _common_drive(flights: Sequence[AirborneFlight]) -> str:
    for drive in DRIVES:
        if all(drive in f.log.series and f.log.series[drive].t.size > 20 for f in flights):
            return drive
    raise InputError(
        "the flights have no channel of commands in common: "
        + ", ".join(f"{f.name}: {f.drive}" for f in flights)
        + f"; accepted: one of {', '.join(DRIVES)} in all of them"
    )


def _with_drive(flight: AirborneFlight, drive: str) -> AirborneFlight:
    return AirborneFlight(flight.name, flight.log, drive, flight.spans, flight.findings)


def _changes(member: Finding, verdict: ChangeVerdict, mass: float, arm: float) -> list[Change]:
    """Return a member as it is reported; of a named pair one entry each."""
    candidate = member.candidate
    whole = sum(m.probability for m in verdict.members)
    sure = member.probability * min(1.0, verdict.confidence / whole)
    theta = _theta(member, mass, arm)
    if verdict.verdict == "named" and "+" in candidate.rotor:
        return [
            Change(candidate.effect, rotor, (part,), sure)
            for rotor, part in zip(candidate.rotor.split("+"), theta, strict=True)
        ]
    found = [Change(candidate.effect, candidate.rotor, theta, sure)]
    if candidate.effect == MASS:
        share = FittedParameter("fraction", "1", 0.0, *_inverse(member))
        found.append(Change(_EQUAL, "", (share,), sure))
    return found


def _inverse(member: Finding) -> tuple[float, float, float]:
    """Return the change of thrust that asks for the same commands as one of mass."""
    value, low, high = (1.0 / (1.0 + x) - 1.0 for x in (member.size, member.low, member.high))
    return value, high, low


def _theta(member: Finding, mass: float, arm: float) -> tuple[FittedParameter, ...]:
    candidate = member.candidate
    size = member.size, member.low, member.high
    if candidate.effect == UNBALANCE:
        return ()
    if candidate.effect == CENTRE:
        half = 0.5 * (member.high - member.low) * arm
        values = [arm * float(x) for x in candidate.sizes]
        return tuple(
            FittedParameter(n, "m", 0.0, v, v - half, v + half)
            for n, v in zip("xy", values, strict=True)
        )
    if candidate.effect == WEAK_PROPELLER:
        rotors = candidate.rotor.split("+")
        return tuple(FittedParameter(r, "1", 0.0, *size) for r in rotors)
    if candidate.effect == MASS:
        return (FittedParameter("fraction", "1", 0.0, *size),)
    return (FittedParameter("mass", "kg", 0.0, *(mass * x for x in size)),)


def _scores(comparison: Comparison) -> tuple[Score, ...]:
    none = max(comparison.none, 1e-300)
    return tuple(
        Score(
            f.candidate.label, math.nan,
            math.log(max(f.probability, 1e-300) / none), f.probability, True,
        )
        for f in comparison.found
    )  # fmt: skip


def _summary(flight: AirborneFlight) -> FlightSummary:
    log = flight.log
    return FlightSummary(
        flight.name, log.source, log.duration_s, flight.used_s, flight.drive,
        tuple(c for c in ("attitude", "gyro", "accel", "voltage") if c not in log.series),
    )  # fmt: skip
