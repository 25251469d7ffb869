"""How much better the extended model predicts points that neither named nor fitted it."""

from __future__ import annotations

import numpy as np

from tombo_diagnosis.engine.gain import gain_of, rms
from tombo_diagnosis.engine.model import Hypothesis
from tombo_diagnosis.engine.model_selection import fit_hypotheses
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.stand.analyse import StandFindings
from tombo_diagnosis.stand.problem import StandProblem
from tombo_diagnosis.stand.tables.operating_points import UNITS, Mask
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.extended_model import Gain


def held_out(findings: StandFindings) -> tuple[list[Gain], dict[str, float]]:
    """Return the gain of every channel, and each effect's share of the excess that it removes.

    One configuration (else run, else fifth of the speeds) after the other is left out; the causes
    are fitted to the others and predict it. Parameters only: random draws can't be predicted.
    """
    problem, points = findings.problem, findings.problem.points
    single_log_bf = findings.search.single_log_bf
    own = tuple(w for w in findings.search.best.hypotheses if w.free)
    tried = {e: (Hypothesis(e, free),) for e in single_log_bf if (free := problem.identifiable(e))}
    before: dict[int, list[float]] = {c: [] for c in points.measured}
    after: dict[int, list[float]] = {c: [] for c in points.measured}
    removed = dict.fromkeys(tried, 0.0)
    columns = problem.columns
    absorbed = {columns.parameters[k].effect for k in columns.absorbed}
    whole = 0.0
    for out in points.blocks():
        rest = points.only(~out)
        if rest.count < 3 or not np.isfinite(rest.readings).any():
            continue
        part = StandProblem(rest, tuple(absorbed))

        def left(fit: Fit, part: StandProblem = part, out: Mask = out) -> Array:
            return np.asarray(problem.residual(part.final(fit))[out])

        base = left(part.null_hypothesis)
        best = left(fit_hypotheses(part, own).fit) if own else base
        for c in points.measured:
            seen = problem.seen[out, c]
            if seen.any():
                before[c].append(rms(base[seen, c]))
                after[c].append(rms(best[seen, c]))
        cost = _cost(problem, base, out)
        whole += max(cost - _cost(problem, best, out), 0.0) if own else cost
        for effect, hypotheses in tried.items():
            one = left(fit_hypotheses(part, hypotheses).fit)
            removed[effect] += cost - _cost(problem, one, out)
    gains = [
        gain_of(CHANNELS[c], UNITS[CHANNELS[c]], "held out", values, after[c])
        for c, values in before.items()
        if values
    ]
    shares = {
        e: float(np.clip(r / whole, 0.0, 1.0)) if whole > 0 else 0.0 for e, r in removed.items()
    }
    return gains, shares


def _cost(problem: StandProblem, left: Array, rows: Mask) -> float:
    return float(np.sum((left / problem.sigma[rows]) ** 2 * problem.seen[rows]))
