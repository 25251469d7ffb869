"""The measurement that separates causes which the data can't tell apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Protocol

from tombo_diagnosis.diagnosis import Experiment
from tombo_diagnosis.wording import listed

_MAX_ADVICE = 6
"""Pairs whose advice is given, the most probable first."""


class _Effect(Protocol):
    @property
    def separates_from(self) -> Mapping[str, str]:
        """Effect → the measurement that tells both apart."""


def separating_experiment(
    members: Sequence[str], effects: Mapping[str, _Effect]
) -> Experiment | None:
    """Return the registry's advice on how to separate the members of a set; None without a set."""
    if len(members) < 2:
        return None
    texts = []
    for a, b in combinations(members, 2):
        advice = effects[a].separates_from.get(b) or effects[b].separates_from.get(a)
        if advice:
            texts.append(f"{advice} ({listed((a, b))})")
    names = listed(members)
    if not texts:
        text = f"No known measurement tells {names} apart; change one of them by hand."
    else:
        text = f"To tell {names} apart: {'; '.join(texts[:_MAX_ADVICE])}."
    return Experiment(tuple(members), text)
