"""From probabilities of candidates to a verdict (none, named, set or unknown), and its words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.change.comparison import CHANGED, CandidateResult, HealthyComparison, Spread
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.signatures import ADDED_WEIGHT, HANGING_LOAD, UNBALANCE, WEAK_PROPELLER
from tombo_diagnosis.engine.verdict import LOG_BF_DISTINCT
from tombo_diagnosis.wording import counted, listed, percent, sized
from tombo_dynamics.vehicle import ROTOR_NAMES

COVERED = 0.8
"""Probability of the members of a set, of all that have changed."""
_LARGEST_SET = 4
_PROBABLE_SET = 3
"""So many are stated where fewer than that can't cover a change, if the truth is more probably
among them than not."""
_UNEXPLAINED = 0.005
"""Surprise at the rest from which on the best candidate is no explanation."""
_ALIKE = (WEAK_PROPELLER, ADDED_WEIGHT, HANGING_LOAD)
"""At the same rotor they ask for the same commands but for a little yaw and collective."""


@dataclass(frozen=True)
class ChangeVerdict:
    """What is said of new flights."""

    verdict: str
    """none, named, set or unknown."""
    members: tuple[CandidateResult, ...]
    """Most probable first; of `unknown`: those that would be needed to cover it."""
    confidence: float


def judge_change(comparison: HealthyComparison, healthy: int) -> ChangeVerdict:
    """Return the verdict; `healthy` flights bound its confidence.

    Of n healthy flights and one more, any is the oddest with probability 1 / (n + 1): no rule can
    be known to raise fewer false alarms.
    """
    most = healthy / (healthy + 1.0)
    if comparison.none > CHANGED:
        return ChangeVerdict("none", (), min(comparison.none, most))
    members = _members(comparison)
    whole = 1.0 - comparison.none
    if members[0].surprise < _UNEXPLAINED:
        return ChangeVerdict("unknown", (), min(whole, most))
    if len(members) > _LARGEST_SET:
        if sum(m.probability for m in members[:_PROBABLE_SET]) < 0.5:
            return ChangeVerdict("unknown", members, min(whole, most))
        members = members[:_PROBABLE_SET]
    sure = min(sum(m.probability for m in members), most)
    return ChangeVerdict("named" if len(members) == 1 else "set", members, sure)


def _members(comparison: HealthyComparison) -> tuple[CandidateResult, ...]:
    """Return the fewest candidates that cover a change, and what equals the first of them.

    One that leaves too much is left out, and so are two rotors where one of them does as well.
    """
    whole, covered = 1.0 - comparison.none, 0.0
    first = comparison.found[0]
    members: list[CandidateResult] = []
    for finding in comparison.found:
        if members and finding.surprise < _UNEXPLAINED:
            continue
        needed = covered < COVERED * whole or _alike(finding, first)
        covered += finding.probability
        if needed and not any(_extends(finding, member) for member in members):
            members.append(finding)
    return tuple(members)


def _alike(finding: CandidateResult, first: CandidateResult) -> bool:
    effects = {finding.candidate.effect, first.candidate.effect}
    return (
        finding.candidate.rotor == first.candidate.rotor
        and effects <= set(_ALIKE)
        and finding.probability > first.probability * math.exp(-LOG_BF_DISTINCT)
    )


def _extends(finding: CandidateResult, member: CandidateResult) -> bool:
    rotors, fewer = (f.candidate.rotor.split("+") for f in (finding, member))
    same = finding.candidate.effect == member.candidate.effect
    return same and len(rotors) > len(fewer) and set(fewer) < set(rotors)


_PHRASES = {
    WEAK_PROPELLER: "a weak propeller",
    ADDED_WEIGHT: "a weight",
    HANGING_LOAD: "a hanging load",
    UNBALANCE: "a propeller out of balance",
    "mass_error": "another mass, or another thrust of all propellers",
    "cog_offset": "another centre of gravity",
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
    day = np.sqrt(np.diag(spread.demand))
    k = int(np.abs(comparison.shift.demand / day).argmax())
    share, usual = np.expm1([comparison.shift.demand[k], day[k]])  # of logarithms
    more = "more" if share > 0.0 else "less"
    text = (
        f"Rotor {ROTOR_NAMES[k].replace('_', ' ')} is asked for {percent(abs(share), 1)} "
        f"{more} thrust than in {counted(spread.flights, 'healthy flight')}, which spread by "
        f"{percent(usual, 1)}; swing {percent(np.expm1(comparison.shift.swing))}."
    )
    if verdict.verdict == "none":
        return f"{text} Healthy flights differ as much. {_would_show(seen)}"
    if verdict.verdict == "unknown":
        first = [
            f"{phrase(f.candidate.label)} ({percent(f.probability)})" for f in verdict.members
        ]
        most = f" Most probable: {listed(first[:4])}." if first else " No candidate explains it."
        return f"{text}{most}"
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
    """Return what can't be certified."""
    n = spread.flights
    lines = [
        f"With {counted(n, 'healthy flight')} a false alarm below {percent(1.0 / (n + 1.0))} "
        f"can't be certified, so no confidence is above {percent(n / (n + 1.0))}; fly healthy "
        "flights on more days.",
        "In hover a weight beside a rotor and a weak propeller there ask for nearly the same "
        "commands. Exchange the propeller: a weight stays, a weak propeller goes.",
        "All new flights are taken to be in one state; a battery that sits elsewhere looks like "
        "another centre of gravity.",
    ]
    if not np.isfinite(new.shake).all() or not np.isfinite(spread.shake).all():
        lines.append("Commands or accelerations are sampled too slowly to show unbalance.")
    return tuple(lines)
