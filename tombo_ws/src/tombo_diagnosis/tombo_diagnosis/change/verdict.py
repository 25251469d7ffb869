"""From probabilities of candidates to a verdict: none, named, set or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tombo_diagnosis.change.comparison import CHANGED, Comparison, Finding
from tombo_diagnosis.change.signatures import ADDED_WEIGHT, HANGING_LOAD, WEAK_PROPELLER
from tombo_diagnosis.engine.verdict import LOG_BF_DISTINCT

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
    members: tuple[Finding, ...]
    """Most probable first; of `unknown`: those that would be needed to cover it."""
    confidence: float


def judge_change(comparison: Comparison, healthy: int) -> ChangeVerdict:
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


def _members(comparison: Comparison) -> tuple[Finding, ...]:
    """Return the fewest candidates that cover a change, and what equals the first of them.

    One that leaves too much is left out, and so are two rotors where one of them does as well.
    """
    whole, covered = 1.0 - comparison.none, 0.0
    first = comparison.found[0]
    members: list[Finding] = []
    for finding in comparison.found:
        if members and finding.surprise < _UNEXPLAINED:
            continue
        needed = covered < COVERED * whole or _alike(finding, first)
        covered += finding.probability
        if needed and not any(_extends(finding, member) for member in members):
            members.append(finding)
    return tuple(members)


def _alike(finding: Finding, first: Finding) -> bool:
    effects = {finding.candidate.effect, first.candidate.effect}
    return (
        finding.candidate.rotor == first.candidate.rotor
        and effects <= set(_ALIKE)
        and finding.probability > first.probability * math.exp(-LOG_BF_DISTINCT)
    )


def _extends(finding: Finding, member: Finding) -> bool:
    rotors, fewer = (f.candidate.rotor.split("+") for f in (finding, member))
    same = finding.candidate.effect == member.candidate.effect
    return same and len(rotors) > len(fewer) and set(fewer) < set(rotors)
