"""Claims about the model as such: one curve for all, the rigid propeller, hover, the figures."""

from __future__ import annotations

from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.reproduce.claims.claim import (
    OPEN,
    ClaimOutcome,
    by_law,
    joined,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper

EXACT = 1e-9


@judges
def universal_curve(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the theorem behind what is said to be the same for every configuration."""
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.collapse),
        lambda d: d < EXACT,
        "A theorem of the equations: one configuration measured at many speeds tests the model "
        "as well as thirteen.",
        exact=f"{EXACT:g}",
    )


@judges
def rigid_lift_over_drag(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the lift over drag of the rigid propeller."""
    ratio = by_law(numbers, lambda law: law.low[0].ratio)
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.rigid_ratio_spread),
        lambda d: d < EXACT,
        f"L/D = {per_law(ratio, '{:.4f}')} at every speed, by construction: C_L and C_D know no "
        "Reynolds number; not measured.",
        exact=f"{EXACT:g}",
        ratio=paper.table_3[0].ratio.text,
    )


@judges
def hover(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the nine propellers can carry the vehicle at all."""
    vehicle = VehicleParams()
    needed = vehicle.hover_thrust()
    soft = [c for c in paper.table_3 if c]
    short = {
        name: ", ".join(str(c) for c in soft if law.thrust[c].value <= needed) or "none"
        for name, law in numbers.laws.items()
    }
    return of_laws(
        numbers,
        by_law(numbers, lambda law: sum(law.thrust[c].value > needed for c in soft)),
        lambda n: n == len(soft),
        f"Too weak for {needed:.2f} N, Conf.: {joined(short)}; the paper flew Conf. 13 only, and "
        "nobody measured thrust above 3200 rpm.",
        mass=f"{vehicle.mass:g}",
        needed=f"{needed:.2f}",
    )


@judges
def curves(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the curves of the figures, whose values are not printed."""
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.thrust[3].value if law.thrust[3].inside else None),
        dict.fromkeys(numbers.laws, OPEN),
        "Recomputed and drawn, but none of their values is printed as a number.",
    )
