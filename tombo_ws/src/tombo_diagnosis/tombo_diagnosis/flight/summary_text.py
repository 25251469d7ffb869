"""A diagnosis of flights in words: the verdict with its figures, and its limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_diagnosis.diagnosis import Cause
from tombo_diagnosis.flight.analyse import MAX_LOG_VARIANCE_EXCESS, FlightAnalysis
from tombo_diagnosis.wording import capital, counted, display_name, listed
from tombo_flight.extended_model import Gain


def gain_sentence(gains: Sequence[Gain]) -> str:
    """Return the gain of the best prediction, in a sentence; empty where none is above zero."""
    steps = [
        g for g in gains if g.horizon == "one step" and g.reduction > 0.05 and not g.low <= 0.0
    ]
    if not steps:
        return ""
    best = max(steps, key=lambda g: g.reduction)
    return (
        f" With it the error of {best.channel} falls from {best.before:.3g} to "
        f"{best.after:.3g} {best.unit} in flights held out."
    )


def summary(findings: FlightAnalysis, causes: Sequence[Cause], gains: Sequence[Gain]) -> str:
    """Return the verdict in a sentence or two."""
    judgement = findings.judgement
    remains = ""
    for worst in findings.remainder.residual_excesses[:1]:
        if worst.excess > MAX_LOG_VARIANCE_EXCESS:
            remains = (
                f"{worst.channel} keeps {worst.measured:.2g} {worst.unit} at {worst.scale_s:g} s"
            )
            if not findings.problem.nominal.calibrated:  # else healthy noise is not known
                remains += f" where chance gives {worst.expected:.2g}"
    if judgement.verdict == "none":
        return "The model predicts these flights as well as chance and its tolerances allow."
    if judgement.verdict == "unknown":
        tail = f": {remains}" if remains else ""
        return f"Something is at work that no candidate explains{tail}."
    if judgement.verdict == "set":
        return (
            f"The flights can't tell {listed(judgement.members)} apart: each explains them. "
            "The experiment below separates them."
        )
    cause_texts = capital("; ".join(_cause_text(cause) for cause in causes))
    gain = gain_sentence(gains)
    if judgement.verdict == "partly_explained":
        rest = remains or "what remains looks like gusts, or like a force it only resembles"
        if findings.remainder.clean_where_explained and remains:
            rest = f"besides, something else is in {listed(findings.remainder.unexplained_groups)}"
            rest += f": {remains}"
        return f"A part is explained. {cause_texts}; {rest}.{gain}"
    besides = ""
    if judgement.members:
        names = listed(judgement.members, "or")
        besides = f" Besides, {names} is at work: these flights can't tell."
    return f"{cause_texts}.{gain}{besides}"


def _cause_text(cause: Cause) -> str:
    """Return a cause with the parameters whose interval leaves the nominal value out."""
    reported = [f for f in cause.theta if not f.low <= f.nominal <= f.high] or list(cause.theta)
    values = ", ".join(
        f"{f.name} {f.value:.3g}{'' if f.unit == '1' else ' ' + f.unit} (was {f.nominal:.3g})"
        for f in reported
    )
    return f"{display_name(cause.effect)}: {values}"


def notes(findings: FlightAnalysis) -> list[str]:
    """Return the limits of the diagnosis, and why."""
    problem = findings.problem
    logs = len({id(track.log) for track in problem.tracks})
    lines = []
    if len(problem.tracks) < 3:
        parts = f", in {len(problem.tracks)} parts" if logs < len(problem.tracks) else ""
        lines.append(
            f"{counted(logs, 'flight')}{parts}: held-out figures come from blocks or "
            "single flights, and have no interval; three flights or more certify."
        )
    if problem.nominal.calibrated:
        lines.append(
            "The vehicle is not the suite's own: thrust was fitted to these flights, so errors of "
            "mass, thrust and level can't be seen, moments are not compared, and what healthy "
            "flights leave over is not known; the level of false alarms can't be certified."
        )
    if not problem.nominal.moments and not problem.nominal.calibrated:
        lines.append(
            "Poses alone: thrust is taken from the track, so nothing along it (mass, thrust, "
            "ground effect) and no moments can be seen; rotor commands or an IMU show them."
        )
    if any(track.formulation == "mocap" for track in problem.tracks):
        rate = np.median([1.0 / np.median(np.diff(track.pose_t)) for track in problem.tracks])
        lines.append(
            f"Without an IMU accelerations come from {rate:.0f} Hz poses: "
            "faults of the IMU can't be seen, and quick effects only in part."
        )
    if findings.problem.vehicles > 1 and len(problem.tracks) > 1:
        lines.append(
            "The rotors differ from flight to flight: other propellers, or other vehicles."
            if logs > 1
            else "The rotors differ from part to part of the flight: the supply, a load or a "
            "propeller may have changed."
        )
    return lines
