"""The recommendation: the first candidate that also flies as claimed, and those that didn't."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tombo_flight.progress import ProgressCallback, no_progress
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Check, check_design
from tombo_propeller.design.request import LEAST_MARGIN

MOST_FLOWN = 8
"""Largest number of candidates that are flown."""
_MORE = 1.05
"""After a failure only a candidate with so much more thrust, or another strike, is flown."""


@dataclass(frozen=True)
class Recommendation:
    """What to build, and the flights behind it."""

    index: int | None
    """Of the candidate; None: nothing keeps to the limits and recovers as well."""
    check: Check | None
    """Its flights; None without flights."""
    upper: Check | None
    """The same with force and recovery time at the upper end of what all readings predict."""
    failed: tuple[tuple[int, Check], ...]
    """Candidates that keep to the limits but not to their claims in flight."""
    unflown: int = 0
    """Feasible candidates that were not flown: too many failed, or one like them did."""
    instead: int | None = None
    """Where all that keep to the limits fail in flight: the nearest candidate that flies."""


def recommend(
    found: Design, seeds: Sequence[int], on_progress: ProgressCallback = no_progress
) -> Recommendation:
    """Fly the feasible candidates in their order until one keeps its claims.

    Args:
        found: the design.
        seeds: of each candidate's flights; without any nothing is flown.
        on_progress: called with the progress.
    """
    order = found.choice.order
    if not order or not seeds:
        return Recommendation(order[0] if order else None, None, None, ())
    failed: list[tuple[int, Check]] = []
    for index in order:
        if len(failed) >= MOST_FLOWN:
            break
        if any(_alike(found, index, other) for other, _ in failed):
            continue
        check = check_design(found, index, seeds, on_progress=on_progress)
        if check.held:
            upper = check_design(found, index, seeds, upper=True, on_progress=on_progress)
            return Recommendation(index, check, upper, tuple(failed))
        failed.append((index, check))
    left = len(order) - len(failed)
    for index in found.choice.nearest:
        lifts = found.judged.value[index, 0] >= LEAST_MARGIN
        if lifts and check_design(found, index, seeds, on_progress=on_progress).flies:
            return Recommendation(None, None, None, tuple(failed), left, index)
    return Recommendation(None, None, None, tuple(failed), left)


def _alike(found: Design, one: int, other: int) -> bool:
    """Return whether a candidate would do no better than one that failed.

    It would if its blades are struck alike, and it has hardly more thrust.
    """
    a, b = found.judged.value[one], found.judged.value[other]
    same = bool((abs(a[1:3] - b[1:3]) <= 1e-9).all())
    return same and bool(a[0] <= _MORE * b[0])
