"""Claims about the model as such: one curve for all, the rigid propeller, hover, the figures."""

from __future__ import annotations

from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.reproduce.claim import OPEN, Claim, by_law, each, joined, judge_of, verdicts
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper

EXACT = 1e-9


def universal(paper: Paper, numbers: Numbers) -> Claim:
    """The theorem behind the claims that something is the same for every configuration."""
    computed = by_law(numbers, lambda law: law.collapse)
    return Claim(
        name="universal_curve",
        group="Maximum thrust",
        kind="check",
        claim="All configurations are one curve of ω²/G_N, when gravity is left out",
        source="Eqs. 1–8",
        paper="–",
        quantity="largest relative difference of T/G_N, γ, L/D between configurations",
        unit="1",
        computed=computed,
        tolerance=f"{EXACT:g} relative, at one E_N/G_N",
        verdicts=verdicts(computed, lambda d: d < EXACT),
        judge=judge_of(numbers),
        evidence="A theorem of the equations: one configuration measured at many speeds tests the "
        "model as well as thirteen.",
    )


def rigid_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """Lift over drag of the rigid propeller."""
    computed = by_law(numbers, lambda law: law.rigid_ratio_spread)
    return Claim(
        name="rigid_lift_over_drag",
        group="Lift over drag",
        kind="stated",
        claim="Lift over drag of the rigid propeller does not depend on speed",
        source="text; Table III, Conf. 0",
        paper=f"constant, {paper.table_3[0].ratio.text}",
        quantity="relative spread from 100 to 18 000 rpm",
        unit="1",
        computed=computed,
        tolerance=f"{EXACT:g}",
        verdicts=verdicts(computed, lambda d: d < EXACT),
        judge=judge_of(numbers),
        evidence=f"L/D = {each(by_law(numbers, lambda law: law.low[0].ratio), '{:.4f}')} at every "
        "speed, by construction: C_L and C_D know no Reynolds number; not measured.",
    )


def hover(paper: Paper, numbers: Numbers) -> Claim:
    """Whether the nine propellers can carry the vehicle at all."""
    vehicle = VehicleParams()
    needed = vehicle.hover_thrust()
    soft = [c for c in paper.table_3 if c]
    computed = by_law(numbers, lambda law: sum(law.thrust[c].value > needed for c in soft))
    short = {
        name: ", ".join(str(c) for c in soft if law.thrust[c].value <= needed) or "none"
        for name, law in numbers.laws.items()
    }
    return Claim(
        name="hover",
        group="Maximum thrust",
        kind="check",
        claim="All nine Tombo propellers of Table III keep enough thrust to hover",
        source="abstract",
        paper="“sufficient thrust”",
        quantity=f"configurations of Table III whose largest thrust carries {vehicle.mass:g} kg",
        unit="1",
        computed=computed,
        tolerance=f"all; {needed:.2f} N a propeller, mass estimated",
        verdicts=verdicts(computed, lambda n: n == len(soft)),
        judge=judge_of(numbers),
        evidence=f"Too weak for {needed:.2f} N, Conf.: {joined(short)}; the paper flew "
        "Conf. 13 only, and nobody measured thrust above 3200 rpm.",
    )


def curves(paper: Paper, numbers: Numbers) -> Claim:
    """The curves of the figures, whose values are not printed."""
    computed = by_law(numbers, lambda law: law.thrust[3].value if law.thrust[3].inside else None)
    return Claim(
        name="curves",
        group="Maximum thrust",
        kind="stated",
        claim="Thrust, α, β, γ and L/D against speed, and T_max, of Conf. 0–3",
        source="figures",
        paper="curves",
        quantity="T_max of Conf. 3",
        unit="N",
        computed=computed,
        tolerance="–",
        verdicts=dict.fromkeys(numbers.laws, OPEN),
        judge=judge_of(numbers),
        evidence="Recomputed and drawn, but none of their values is printed as a number.",
    )


MODEL_CLAIMS = (rigid_ratio, hover, universal, curves)
