"""The test of causes on flights that were held out: none may make a prediction surely worse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.engine.model_selection import restrict_to
from tombo_diagnosis.engine.verdict import analyse_problem
from tombo_diagnosis.flight.analyse import FlightFindings, check_residual
from tombo_diagnosis.flight.cross_validation import (
    fit_without_flight,
    one_step_gains,
    open_loop_gains,
)
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_flight.extended_model import Gain
from tombo_flight.progress import no_progress

_WORSE = -0.1
"""Reduction of an error below which a change for the worse is one; less is what tolerances of
other parameters make of it when they are fitted again."""
_JUDGED = ("force", "acceleration", "mocap against", "gyro against", "position", "velocity")
"""Channels that are judged: moments, speeds and voltage follow the balance of the rotors and the
state of the battery first, whatever the cause."""
_MAX_REFUSED = 3


def final_explanation(findings: FlightFindings) -> Explanation:
    """Return the explanation that goes into the model: of what is sure, or the most probable."""
    judgement = findings.judgement
    best = findings.search.best
    if judgement.verdict in ("none", "unknown"):
        return Explanation((), findings.problem.null_hypothesis, 0.0)
    if judgement.verdict == "set":
        return best
    return restrict_to(findings.problem, best, judgement.effects)


def with_parts(problem: FlightProblem, final: Explanation) -> list[Explanation]:
    """Return an explanation and each of its causes alone: what flights are held out from."""
    if len(final.hypotheses) < 2:
        return [final]
    return [final, *(restrict_to(problem, final, (e,)) for e in final.effects)]


def held_out_gains(findings: FlightFindings, final: Explanation) -> list[Gain]:
    """Return how much better each channel of each flight is predicted by what others taught."""
    if not final.hypotheses:
        return []
    problem = findings.problem
    tried = with_parts(problem, final)
    tried += findings.search.alternatives if findings.judgement.members else ()
    held = [fit_without_flight(problem, f, tried) for f in range(len(problem.tracks))]
    return one_step_gains(problem, held) + open_loop_gains(problem, held)


def surely_worse(gains: Sequence[Gain]) -> list[Gain]:
    """Return the judged channels whose prediction gets surely worse (an interval below zero)."""
    return [
        g for g in gains if g.high < 0.0 and g.reduction < _WORSE and g.channel.startswith(_JUDGED)
    ]


@dataclass(frozen=True)
class HeldOutTest:
    """What is left of the findings when flights that were held out have been asked."""

    findings: FlightFindings
    final: Explanation
    """What goes into the model."""
    gains: list[Gain]
    """What it is worth."""
    refused: dict[str, str]
    """Effect -> what speaks against it, of causes that these flights contradict."""


def refuse_contradicted(findings: FlightFindings) -> HeldOutTest:
    """Take away causes that held-out flights contradict.

    A cause that makes the prediction of a channel surely worse goes, of several the least that
    does; then the search begins again without it.
    """
    refused: dict[str, str] = {}
    while True:
        final = final_explanation(findings)
        gains = held_out_gains(findings, final)
        worse = surely_worse(gains)
        if not worse or len(refused) == _MAX_REFUSED:
            return HeldOutTest(findings, final, gains, refused)
        worst = min(worse, key=lambda g: g.reduction)
        refused[_culprit(findings, final, worst)] = _words(worst)
        problem = findings.problem
        problem.refuse(refused)
        again = analyse_problem(problem, check_residual, no_progress)
        findings = replace(
            again, remainder=replace(again.remainder, excluded=findings.remainder.excluded)
        )


def _culprit(findings: FlightFindings, final: Explanation, worst: Gain) -> str:
    """Return the least of the causes without which a channel is not surely predicted worse.

    If there is none, the cause that the evidence misses least.
    """
    problem = findings.problem
    without = {
        effect: restrict_to(problem, final, [e for e in final.effects if e != effect])
        for effect in final.effects
    }
    least_first = sorted(without, key=lambda effect: -without[effect].evidence)
    for effect in least_first:
        left = surely_worse(held_out_gains(findings, without[effect]))
        if (worst.channel, worst.horizon) not in {(g.channel, g.horizon) for g in left}:
            return effect
    return least_first[0]


def _words(gain: Gain) -> str:
    return (
        f"with it {gain.channel} ({gain.horizon}) is predicted {-100.0 * gain.reduction:.0f} % "
        "worse in flights held out"
    )
