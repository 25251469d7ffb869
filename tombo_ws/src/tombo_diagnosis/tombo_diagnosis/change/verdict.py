"""From probabilities of candidates to a verdict (none, named, set or unknown), and its words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.change.comparison import CHANGED, CandidateResult, HealthyComparison, Spread
from tombo_diagnosis.change.features import SHAKE, SWING, Features
from tombo_diagnosis.change.signatures import (
    ADDED_WEIGHT,
    HANGING_LOAD,
    OTHER,
    UNBALANCE,
    WEAK_PROPELLER,
)
from tombo_diagnosis.engine.verdict import succession
from tombo_diagnosis.wording import counted, listed, percent, sized
from tombo_dynamics.vehicle import ROTOR_NAMES

NAMED, COVERED = 0.9, 0.7
"""Probability from which on one cause is named, and of the members of a set."""
_LARGEST_SET = 3
_ALIKE = (WEAK_PROPELLER, ADDED_WEIGHT, HANGING_LOAD)
"""At the same rotor they need the same commands. They differ by a little yaw and collective, which
are too uncertain to name one of them."""


@dataclass(frozen=True)
class ChangeVerdict:
    """Verdict on new flights."""

    verdict: str
    """none, named, set or unknown."""
    members: tuple[CandidateResult, ...]
    """Most probable first; of `unknown`: all candidates that have a name."""
    confidence: float


_ACCUSED_OF_MANY, _ACCUSED_OF_ONE = 0.08, 1.0 / 3.0
"""Share of healthy sessions of other vehicles that are called changed: by three others of the
vehicle 1 of 12; by a single one, the share of vehicles, by Laplace's rule: one of four
Crazyflies, in 5 of its 12 pairs (of the three others in none of 26)."""


def most_confident(spread: Spread) -> float:
    """Return the share of healthy sessions that are not called changed, a bound of confidence.

    A single session says nothing of a further one.
    """
    if spread.days_unknown:
        return succession(0, 0, _ACCUSED_OF_ONE)
    return succession(spread.left_out, spread.false_alarms, _ACCUSED_OF_MANY)


def judge_change(comparison: HealthyComparison, most: float) -> ChangeVerdict:
    """Return the verdict.

    `most` (`most_confident`) bounds its confidence; the probability of a cause is its share of the
    change, times that.
    """
    if comparison.none > CHANGED:
        return ChangeVerdict("none", (), min(comparison.none, most))
    known = [r for r in comparison.results if r.candidate.effect != OTHER]
    members, covered = [known[0]], most * known[0].probability
    if covered < NAMED:
        for result in known[1:_LARGEST_SET]:
            members.append(result)
            covered += most * result.probability
            if covered >= COVERED:
                break
        else:
            return ChangeVerdict("unknown", tuple(known), min(1.0 - comparison.none, most))
    for result in known:
        if len(members) < _LARGEST_SET and result not in members and _alike(result, known[0]):
            members.append(result)
            covered += most * result.probability
    verdict = "named" if len(members) == 1 else "set"
    return ChangeVerdict(verdict, tuple(members), covered)


def _alike(result: CandidateResult, first: CandidateResult) -> bool:
    effects = {result.candidate.effect, first.candidate.effect}
    return result.candidate.rotor == first.candidate.rotor and effects <= set(_ALIKE)


_PHRASES = {
    WEAK_PROPELLER: "a weak propeller",
    ADDED_WEIGHT: "a weight",
    HANGING_LOAD: "a hanging load",
    UNBALANCE: "a propeller out of balance",
    "mass_error": "another mass, or another thrust of all propellers",
    "cog_offset": "another centre of gravity",
    OTHER: "something else",
}


def phrase(label: str) -> str:
    """Return a candidate in words."""
    effect, _, rotor = label.partition(".")
    name = _PHRASES.get(effect, effect.replace("_", " "))
    if not rotor:
        return name
    return f"{name} at rotor {rotor.replace('_', ' ').replace('+', ' and at rotor ')}"


def headline(verdict: str, labels: tuple[str, ...]) -> str:
    """Return the verdict as one sentence in large words."""
    if verdict == "none":
        return "Nothing has changed that these flights show"
    if verdict == "unknown":
        return "Something has changed; these flights do not tell what"
    phrases = [phrase(label) for label in labels]
    return f"What has changed: {listed(phrases, 'or')}"


def summary(
    verdict: ChangeVerdict,
    spread: Spread,
    comparison: HealthyComparison,
    seen: Mapping[str, float],
) -> str:
    """Return the verdict in a sentence or two, with figures.

    `seen`: candidate -> the smallest of its sizes that would have been seen (`smallest_seen`).
    """
    day = np.sqrt(np.diag(spread.scale(1))[:4])
    k = int(np.abs(comparison.shift.demand / day).argmax())
    share = np.expm1(comparison.shift.demand[k])  # of a logarithm
    more = "more" if share > 0.0 else "less"
    text = (
        f"Rotor {ROTOR_NAMES[k].replace('_', ' ')} is asked for {percent(abs(share), 1)} "
        f"{more} thrust than in {counted(spread.flights, 'healthy flight')}; all four rotors "
        f"together are as far off in {percent(comparison.usual)} of healthy flights of "
        f"{'a further' if spread.session.any() else 'this'} session; swing "
        f"{percent(np.expm1(comparison.shift.vector[SWING]))}."
    )
    if verdict.verdict == "none":
        return f"{text} {_would_show(seen)}"
    if verdict.verdict == "unknown":
        likely = [
            f"{phrase(m.candidate.label)} ({percent(m.probability)})" for m in verdict.members
        ]
        return f"{text} Most probable: {listed(likely[:3])}."
    members = listed([phrase(m.candidate.label) for m in verdict.members], "or")
    return f"{text} That is what {members} asks for."


def _would_show(seen: Mapping[str, float]) -> str:
    """Return the smallest changes that would have been seen; of rotors, at the worst of them."""
    worst: dict[str, float] = {}
    for label, size in seen.items():
        effect = label.partition(".")[0]
        worst[effect] = max(size, worst.get(effect, 0.0))
    shown = [
        f"{_PHRASES[effect]} from {sized(size, '1')}"
        for effect, size in worst.items()
        if np.isfinite(size)
    ]
    if not shown:
        return "They differ so much that no change at all would have been seen."
    return f"These flights would have shown {listed(shown)}; what is smaller is not seen here."


def notes(spread: Spread, new: Features) -> tuple[str, ...]:
    """Return the claims that can't be certified."""
    among = (
        "All healthy flights are of one session: how much sessions differ is as of other vehicles"
        if spread.sessions == 1
        else f"The healthy flights are of {counted(spread.sessions, 'session')}"
    )
    if spread.left_out:
        among += (
            f"; left out in turn, {spread.false_alarms} of {spread.left_out} are called changed. "
            f"A rate of false alarms below {percent(1.0 / (spread.left_out + 1.0))} can't be "
            "certified by them"
        )
    lines = [
        f"{among}. Fly healthy flights on more days.",
        "In hover a weight beside a rotor and a weak propeller there ask for nearly the same "
        "commands. Exchange the propeller: a weight stays, a weak propeller goes.",
        "All new flights are taken to be in one state; a battery that sits elsewhere looks like "
        "another centre of gravity.",
    ]
    if not np.isfinite([new.vector[SHAKE], spread.mean.vector[SHAKE]]).all():
        lines.append("Commands or accelerations are sampled too slowly to show unbalance.")
    return tuple(lines)
