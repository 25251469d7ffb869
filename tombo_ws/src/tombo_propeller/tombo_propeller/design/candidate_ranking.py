"""Ranking of the candidates; the relief of each limit and the nearest candidates if none fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_propeller.design.candidate_evaluation import CandidateEvaluation, costs, slack
from tombo_propeller.design.pareto import nondominated
from tombo_propeller.design.request import NAMES, Limit

_NEAREST = 3
"""Candidates that break a limit and are named."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Which candidates keep to the limits, and in which order they come."""

    limits: tuple[Limit, ...]
    slack: Array
    """(n, limits), see `candidate_evaluation.slack`."""
    feasible: NDArray[np.bool_]
    front: NDArray[np.bool_]
    """Feasible and not beaten by another one of as good evidence; less far outside of what was
    tested is better, too."""
    order: tuple[int, ...]
    """Feasible candidates, the recommended one first."""
    relief: tuple[float | None, ...]
    """For each limit, the value at which one candidate would keep to all, the other limits as they
    are; None: none would, however far this one gives."""
    nearest: tuple[int, ...]
    """Candidates that break the limits least."""


def choose(judged: CandidateEvaluation, limits: Sequence[Limit], gain: float) -> Choice:
    """Order the candidates that keep the limits, and find how far the others are from them.

    Evidence comes first: what was measured before what is predicted within the tested range, that
    before what is extrapolated. Within each, the candidate whose smallest slack is largest, of
    those on the front; of what is extrapolated the one that is least so. A prediction within the
    tested range overtakes a measurement only if its smallest slack is larger by more than `gain`.

    Args:
        judged: the candidates.
        limits: what to keep to.
        gain: share that the model must gain to be believed over a measurement: its own error.
    """
    left = slack(judged.counted, limits)
    worst = left.min(axis=1)
    feasible = worst >= 0.0
    front = np.zeros_like(feasible)
    for tier in range(3):
        here = feasible & (judged.tier == tier)
        front[here] = _front(judged, here)
    return Choice(
        tuple(limits),
        left,
        feasible,
        front,
        _order(judged, worst, feasible, front, gain),
        tuple(_relief(judged, left, k, limits) for k in range(len(limits))),
        tuple(int(i) for i in _by_slack(worst, ~feasible, judged.tier)[:_NEAREST]),
    )


def _front(judged: CandidateEvaluation, here: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which candidates `here` are on their Pareto front; unknown figures are left out."""
    figures = np.column_stack([costs(judged.counted[here]), judged.distance[here]])
    known = np.isfinite(figures).any(axis=0)
    return nondominated(figures[:, known]) if here.any() else np.zeros(0, dtype=bool)


def _order(
    judged: CandidateEvaluation,
    worst: Array,
    feasible: NDArray[np.bool_],
    front: NDArray[np.bool_],
    gain: float,
) -> tuple[int, ...]:
    indices = np.flatnonzero(feasible)
    if not indices.size:
        return ()
    keys = (-judged.counted[indices, 0], -worst[indices], judged.distance[indices],
            ~front[indices], judged.tier[indices])  # fmt: skip
    ordered = [int(i) for i in indices[np.lexsort(keys)]]
    first = ordered[0]
    within = [i for i in ordered if judged.tier[i] == 1]
    if within and judged.tier[first] == 0 and worst[within[0]] > worst[first] + gain:
        first = within[0]
    ordered.remove(first)
    return (first, *ordered)


def _by_slack(worst: Array, among: NDArray[np.bool_], tier: NDArray[np.int64]) -> Array:
    indices = np.flatnonzero(among & np.isfinite(worst))
    return np.asarray(indices[np.lexsort((tier[indices], -worst[indices]))])


def _relief(
    judged: CandidateEvaluation, left: Array, k: int, limits: Sequence[Limit]
) -> float | None:
    others = np.delete(left, k, axis=1)
    able = (others >= 0.0).all(axis=1)
    figures = judged.counted[able, NAMES.index(limits[k].quantity.name)]
    figures = figures[np.isfinite(figures)]
    if not figures.size:
        return None
    return float(figures.max() if limits[k].quantity.more_is_better else figures.min())
