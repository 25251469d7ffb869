"""Claims about thrust: the model against the thrusts that Table III prints as measured."""

from __future__ import annotations

import numpy as np

from tombo_propeller.reproduce.claim import (
    FAILS,
    OPEN,
    Claim,
    Verdict,
    by_law,
    each,
    holds_if,
    judge_of,
    verdicts,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper


def error_percent(paper: Paper, law: LawNumbers, conf: int) -> float:
    """Return how far computed thrust is from the measured one at 2000 rpm [%]."""
    return 100.0 * (law.low[conf].thrust_N / paper.table_3[conf].thrust_N.value - 1.0)


def error_as_claimed(paper: Paper, numbers: Numbers) -> Claim:
    """The bound of 8 %, where the paper claims it."""
    bound = paper.number("model", "thrust_error_percent")
    claimed = [int(c) for c in paper.said["model"]["thrust_configurations"]]
    known = [c for c in claimed if c in paper.table_3]

    def worst(law: LawNumbers) -> float | None:
        errors = [error_percent(paper, law, c) for c in known]
        return max(errors, key=abs) if errors else None

    computed = by_law(numbers, worst)

    def verdict(error: float | None) -> Verdict:
        if error is not None and abs(error) >= bound.value:
            return FAILS
        return OPEN if len(known) < len(claimed) else holds_if(error is not None)

    speeds = " to ".join(paper.said["model"]["thrust_speeds_rpm"])
    return Claim(
        name="thrust_error",
        group="Thrust",
        kind="stated",
        claim=f"Thrust of Conf. 0–3 is within {bound.text} % of measurement, {speeds} rpm",
        source=paper.source("model", "thrust_error_percent"),
        paper=f"< {bound.text} %",
        quantity="largest error at the points printed as numbers",
        unit="%",
        computed=computed,
        tolerance=f"{bound.text} %",
        verdicts={law: verdict(error) for law, error in computed.items()},
        judge=judge_of(numbers),
        evidence=f"Of {len(claimed)} propellers only Conf. {', '.join(map(str, known))} has a "
        f"measured thrust in print, at one speed.",
    )


def error_in_table_3(paper: Paper, numbers: Numbers) -> Claim:
    """The same bound where thrusts are printed."""
    bound = paper.number("model", "thrust_error_percent")
    soft = [c for c in paper.table_3 if c]
    errors = {
        name: {c: error_percent(paper, law, c) for c in soft} for name, law in numbers.laws.items()
    }
    worst = {name: max(found, key=lambda c: abs(found[c])) for name, found in errors.items()}
    computed = {name: found[worst[name]] for name, found in errors.items()}
    within = {
        name: sum(abs(e) < bound.value for e in found.values()) for name, found in errors.items()
    }
    where = "; ".join(
        f"{name} {computed[name]:+.1f} % (Conf. {worst[name]}), {within[name]} of {len(soft)} "
        "within"
        for name in errors
    )
    values: dict[str, float | None] = dict(computed)
    return Claim(
        name="thrust_error_table_3",
        group="Thrust",
        kind="check",
        claim=f"The {bound.text} % also hold for the nine propellers of Table III",
        source="Table III",
        paper=f"< {bound.text} %",
        quantity="largest error, Conf. 5–13 at 2000 rpm",
        unit="%",
        computed=values,
        tolerance=f"{bound.text} %",
        verdicts=verdicts(values, lambda e: abs(e) < bound.value),
        judge=judge_of(numbers),
        evidence=f"Largest error: {where}.",
    )


def centrifugal_stiffening(paper: Paper, numbers: Numbers) -> Claim:
    """The paper's remark that the spinning propeller becomes stiff."""
    soft = [c for c in paper.table_3 if c]
    rigid = paper.table_3[0].thrust_N.value
    loss = 100.0 * (1.0 - float(np.mean([paper.table_3[c].thrust_N.value for c in soft])) / rigid)
    computed = by_law(numbers, lambda law: law.high[13].gamma_deg / law.low[13].gamma_deg)
    low, high = paper.said["model"]["thrust_speeds_rpm"]
    return Claim(
        name="centrifugal_stiffening",
        group="Thrust",
        kind="stated",
        claim="The propeller becomes quite stiff due to centrifugal force",
        source="text",
        paper="“quite stiff”",
        quantity=f"twist of Conf. 13 at {high} over that at {low} rpm",
        unit="1",
        computed=computed,
        tolerance="1 if twist is limited by centrifugal force alone",
        verdicts=dict.fromkeys(numbers.laws, OPEN),
        judge=judge_of(numbers),
        evidence=f"In the laws the twist goes on growing ({each(computed, '× {:.2f}')}); measured "
        f"thrust is {loss:.1f} % below the rigid one's whatever the stiffness, as the sentence "
        "would have it, but neither twist nor torque was measured.",
    )


THRUST_CLAIMS = (error_as_claimed, error_in_table_3, centrifugal_stiffening)
