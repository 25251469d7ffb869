"""How much better the extended model predicts points that neither named nor fitted it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tombo_diagnosis.stand.analyse import Findings
from tombo_diagnosis.stand.model_selection import Hypothesis, fit_hypotheses
from tombo_diagnosis.stand.operating_points import UNITS
from tombo_diagnosis.stand.problem import Problem
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.extended_model import Gain

Array = NDArray[np.float64]

_FEW = 3


def held_out(findings: Findings) -> tuple[list[Gain], dict[str, float]]:
    """Return the gain of every channel, and each effect's share of the excess that it removes.

    One configuration (else run, else fifth of the speeds) after the other is left out; the causes
    are fitted to the others and predict it. Parameters only: what chance did is not foretold.
    """
    problem, points = findings.problem, findings.problem.points
    single_log_bf = findings.search.single_log_bf
    own = [w for w in findings.search.best.hypotheses if w.free]
    tried = {
        e: (Hypothesis(e, problem.identifiable(e)),)
        for e in single_log_bf
        if problem.identifiable(e)
    }
    before: dict[int, list[float]] = {c: [] for c in points.measured}
    after: dict[int, list[float]] = {c: [] for c in points.measured}
    removed = dict.fromkeys(tried, 0.0)
    whole = 0.0
    for _, out in points.blocks():
        rest = points.only(~out)
        if rest.count < 3 or not np.isfinite(rest.readings).any():
            continue
        part = Problem(rest, tuple({problem.parameters[k].effect for k in problem.absorbed}))
        base = _left(problem, part.final(part.null_hypothesis), out)
        best = base
        if own:
            best = _left(problem, part.final(fit_hypotheses(part, tuple(own)).fit), out)
        for c in points.measured:
            seen = problem.seen[out, c]
            if seen.any():
                before[c].append(float(np.sqrt(np.mean(base[seen, c] ** 2))))
                after[c].append(float(np.sqrt(np.mean(best[seen, c] ** 2))))
        cost = _cost(problem, base, out)
        whole += max(cost - _cost(problem, best, out), 0.0) if own else cost
        for effect, hypotheses in tried.items():
            one = _left(problem, part.final(fit_hypotheses(part, hypotheses).fit), out)
            removed[effect] += cost - _cost(problem, one, out)
    gains = [_gain(c, before[c], after[c]) for c in points.measured if before[c]]
    shares = {
        e: float(np.clip(r / whole, 0.0, 1.0)) if whole > 0 else 0.0 for e, r in removed.items()
    }
    return gains, shares


def _left(problem: Problem, theta: Array, rows: NDArray[np.bool_]) -> Array:
    return np.asarray(problem.residual(theta)[rows])


def _cost(problem: Problem, left: Array, rows: NDArray[np.bool_]) -> float:
    return float(np.sum((left / problem.sigma[rows]) ** 2 * problem.seen[rows]))


def _gain(c: int, before: list[float], after: list[float]) -> Gain:
    b, a = np.array(before), np.array(after)
    total_b, total_a = float(np.sqrt(np.mean(b**2))), float(np.sqrt(np.mean(a**2)))
    reduction = 1.0 - total_a / total_b if total_b > 0.0 else 0.0
    low = high = math.nan
    if b.size >= _FEW and (b > 0.0).all() and (a > 0.0).all():
        logs = np.log(a / b)
        half = float(stats.t.ppf(0.975, b.size - 1)) * float(logs.std(ddof=1)) / math.sqrt(b.size)
        low = min(1.0 - math.exp(float(logs.mean()) + half), reduction)
        high = max(1.0 - math.exp(float(logs.mean()) - half), reduction)
    name = CHANNELS[c]
    return Gain(name, UNITS[name], "held out", total_b, total_a, reduction, low, high, int(b.size))
