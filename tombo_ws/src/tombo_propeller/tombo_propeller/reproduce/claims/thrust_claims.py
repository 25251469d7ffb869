"""Claims about thrust: the model against the thrusts that Table III prints as measured."""

from __future__ import annotations

import numpy as np

from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    OPEN,
    ClaimOutcome,
    Verdict,
    by_law,
    holds_if,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper


def error_percent(paper: Paper, law: LawNumbers, conf: int) -> float:
    """Return how far computed thrust is from the measured one at 2000 rpm [%]."""
    return 100.0 * (law.low[conf].thrust_N / paper.table_3[conf].thrust_N.value - 1.0)


@judges
def thrust_error(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the bound of 8 %, where the paper claims it."""
    bound = paper.number("model", "thrust_error_percent").value
    claimed = [int(c) for c in paper.said["model"]["thrust_configurations"]]
    known = [c for c in claimed if c in paper.table_3]

    def worst(law: LawNumbers) -> float | None:
        return max((error_percent(paper, law, c) for c in known), key=abs, default=None)

    def verdict(error: float | None) -> Verdict:
        if error is not None and abs(error) >= bound:
            return FAILS
        return OPEN if len(known) < len(claimed) else holds_if(error is not None)

    computed = by_law(numbers, worst)
    return of_laws(
        numbers,
        computed,
        {law: verdict(error) for law, error in computed.items()},
        f"Of {len(claimed)} propellers only Conf. {', '.join(map(str, known))} has a measured "
        "thrust in print, at one speed.",
        speeds=" to ".join(paper.said["model"]["thrust_speeds_rpm"]),
    )


@judges
def thrust_error_table_3(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the same bound where thrusts are printed."""
    bound = paper.number("model", "thrust_error_percent").value
    soft = [c for c in paper.table_3 if c]
    errors = {
        name: {c: error_percent(paper, law, c) for c in soft} for name, law in numbers.laws.items()
    }
    worst = {name: max(found, key=lambda c: abs(found[c])) for name, found in errors.items()}
    where = "; ".join(
        f"{name} {found[worst[name]]:+.1f} % (Conf. {worst[name]}), "
        f"{sum(abs(e) < bound for e in found.values())} of {len(soft)} within"
        for name, found in errors.items()
    )
    return of_laws(
        numbers,
        {name: found[worst[name]] for name, found in errors.items()},
        lambda e: abs(e) < bound,
        f"Largest error: {where}.",
    )


@judges
def centrifugal_stiffening(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the paper's remark that the spinning propeller becomes stiff."""
    soft = [c for c in paper.table_3 if c]
    rigid = paper.table_3[0].thrust_N.value
    loss = 100.0 * (1.0 - float(np.mean([paper.table_3[c].thrust_N.value for c in soft])) / rigid)
    computed = by_law(numbers, lambda law: law.high[13].gamma_deg / law.low[13].gamma_deg)
    low, high = paper.said["model"]["thrust_speeds_rpm"]
    return of_laws(
        numbers,
        computed,
        dict.fromkeys(numbers.laws, OPEN),
        f"In the laws the twist goes on growing ({per_law(computed, '× {:.2f}')}); measured "
        f"thrust is {loss:.1f} % below the rigid one's whatever the stiffness, as the sentence "
        "would have it, but neither twist nor torque was measured.",
        low=low,
        high=high,
    )
