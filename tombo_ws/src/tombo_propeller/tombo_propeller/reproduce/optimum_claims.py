"""Claims about the optima over speed: lift over drag, thrust, and the twist there."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from tombo_propeller.reproduce.claim import Claim, by_law, joined, judge_of, verdicts
from tombo_propeller.reproduce.computed_values import Numbers, Optimum
from tombo_propeller.reproduce.paper_values import Paper

SAME_ANGLE_DEG = 0.1
"""No twist is printed at the optima; a figure shows no finer difference."""


def largest_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """The value of eps_mld."""
    printed = paper.number("model", "largest_lift_over_drag")
    computed = by_law(
        numbers, lambda law: _worst([o.value for o in law.ratio.values()], printed.value)
    )
    return Claim(
        name="eps_mld",
        group="Lift over drag",
        kind="printed",
        claim="The largest lift over drag",
        source=paper.source("model", "largest_lift_over_drag"),
        paper=printed.text,
        quantity="ε_mld of the configuration farthest from the printed value",
        unit="1",
        computed=computed,
        tolerance="to the last printed digit, in all of Conf. 1–13",
        verdicts=verdicts(computed, printed.agrees),
        judge=judge_of(numbers),
        evidence="Most of the difference between the laws is drag weighted with cos(θ + γ), where "
        "Eq. 8 has cos(θ − γ).",
    )


def same_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """eps_mld is said to be one number for all."""
    half = paper.number("model", "largest_lift_over_drag").half
    computed = by_law(
        numbers,
        lambda law: _spread(law.ratio, "value"),
    )
    return Claim(
        name="eps_mld_same",
        group="Lift over drag",
        kind="stated",
        claim="The largest lift over drag is the same for every configuration",
        source=paper.source("model", "largest_lift_over_drag"),
        paper="one value",
        quantity="largest difference between configurations",
        unit="1",
        computed=computed,
        tolerance=f"{2.0 * half:g}, the last printed digit",
        verdicts=verdicts(computed, lambda d: d < 2.0 * half),
        judge=judge_of(numbers),
        evidence=f"It must be so ({_without(numbers, 'ratio')}): without gravity the equations "
        "know only ω²/G_N.",
    )


def same_twist_ratio(paper: Paper, numbers: Numbers) -> Claim:
    """The twist at maximum lift over drag is said to be the same for every configuration."""
    return _same_twist(numbers, "ratio", "gamma_mld", "maximum lift over drag", "Lift over drag")


def order(paper: Paper, numbers: Numbers) -> Claim:
    """omega_mtf grows with stiffness."""
    confs = [int(c) for c in paper.said["model"]["ordered_configurations"]]

    def rising(thrust: Mapping[int, Optimum]) -> float | None:
        speeds = [thrust[c].speed_rpm for c in confs]
        if not all(thrust[c].inside for c in confs):
            return None
        return min(b - a for a, b in pairwise(speeds))

    computed = by_law(numbers, lambda law: rising(law.thrust))
    speeds = {
        name: "no maximum up to 18 000 rpm"
        if computed[name] is None
        else " < ".join(f"{law.thrust[c].speed_rpm:.0f}" for c in confs) + " rpm"
        for name, law in numbers.laws.items()
    }
    return Claim(
        name="omega_mtf_order",
        group="Maximum thrust",
        kind="stated",
        claim="The speed of maximum thrust grows with stiffness: Conf. 1 < Conf. 2 < Conf. 3",
        source="text, ω_mtf",
        paper="1 < 2 < 3",
        quantity="smallest step of ω_mtf from one configuration to the next",
        unit="rpm",
        computed=computed,
        tolerance="above 0",
        verdicts=verdicts(computed, lambda d: d > 0.0),
        judge=judge_of(numbers),
        evidence=f"{joined(speeds)}: that there is a maximum at all hangs on one disputed "
        "in-plane term of the twist.",
    )


def same_twist_thrust(paper: Paper, numbers: Numbers) -> Claim:
    """The twist at maximum thrust is said to be the same for every configuration."""
    return _same_twist(numbers, "thrust", "gamma_mtf", "maximum thrust", "Maximum thrust")


def _same_twist(numbers: Numbers, which: str, name: str, at: str, group: str) -> Claim:
    computed = by_law(numbers, lambda law: _spread(getattr(law, which), "gamma_deg"))
    values = {
        law: "none"
        if computed[law] is None
        else f"{min(o.gamma_deg for o in found.values()):.2f}–"
        f"{max(o.gamma_deg for o in found.values()):.2f}°"
        for law, found in ((n, getattr(x, which)) for n, x in numbers.laws.items())
    }
    return Claim(
        name=name,
        group=group,
        kind="stated",
        claim=f"The twist at {at} is the same for every configuration",
        source="text, γ",
        paper="one value",
        quantity="largest difference of γ between configurations",
        unit="deg",
        computed=computed,
        tolerance=f"{SAME_ANGLE_DEG:g} deg; the angle itself is not printed",
        verdicts=verdicts(computed, lambda d: d < SAME_ANGLE_DEG),
        judge=judge_of(numbers),
        evidence=f"γ there: {joined(values)}; a theorem where there is a maximum, not an "
        "observation.",
    )


def _worst(values: list[float], target: float) -> float:
    return max(values, key=lambda v: abs(v - target))


def _spread(optima: Mapping[int, Optimum], name: str) -> float | None:
    """Return the largest difference between configurations, None unless all have a maximum."""
    if not all(o.inside for o in optima.values()):
        return None
    values = [getattr(o, name) for o in optima.values()]
    return float(max(values) - min(values))


def _without(numbers: Numbers, which: str) -> str:
    """Say which laws have no maximum."""
    found = [
        name
        for name, law in numbers.laws.items()
        if not all(o.inside for o in getattr(law, which).values())
    ]
    return f"{', '.join(found)}: still rising at 18 000 rpm" if found else "all have a maximum"


OPTIMUM_CLAIMS = (largest_ratio, same_ratio, same_twist_ratio, order, same_twist_thrust)
