"""Claims about the optima over speed: lift over drag, thrust, and the twist there."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from tombo_propeller.reproduce.claims.claim import ClaimOutcome, by_law, joined, judges, of_laws
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers, Optimum
from tombo_propeller.reproduce.paper_values import Paper

SAME_ANGLE_DEG = 0.1
"""No twist is printed at the optima; a figure shows no finer difference."""


@judges
def eps_mld(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the value of eps_mld."""
    printed = paper.number("model", "largest_lift_over_drag")

    def farthest(law: LawNumbers) -> float:
        values = [o.value for o in law.ratio.values()]
        return max(values, key=lambda v: abs(v - printed.value))

    return of_laws(
        numbers,
        by_law(numbers, farthest),
        printed.agrees,
        "Most of the difference between the laws is drag weighted with cos(θ + γ), where Eq. 8 "
        "has cos(θ − γ).",
    )


@judges
def eps_mld_same(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether eps_mld is one number for all."""
    digit = 2.0 * paper.number("model", "largest_lift_over_drag").half
    rising = [n for n, law in numbers.laws.items() if _spread(law.ratio, "value") is None]
    maxima = "all have a maximum"
    if rising:
        maxima = f"{', '.join(rising)}: still rising at 18 000 rpm"
    return of_laws(
        numbers,
        by_law(numbers, lambda law: _spread(law.ratio, "value")),
        lambda d: d < digit,
        f"It must be so ({maxima}): without gravity the equations know only ω²/G_N.",
        digit=f"{digit:g}",
    )


@judges
def gamma_mld(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the twist at maximum lift over drag is the same for every configuration."""
    return _same_twist(numbers, "ratio")


@judges
def omega_mtf_order(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether omega_mtf grows with stiffness."""
    confs = [int(c) for c in paper.said["model"]["ordered_configurations"]]

    def rising(law: LawNumbers) -> float | None:
        speeds = [law.thrust[c].speed_rpm for c in confs]
        if not all(law.thrust[c].inside for c in confs):
            return None
        return min(b - a for a, b in pairwise(speeds))

    computed = by_law(numbers, rising)
    speeds = {
        name: "no maximum up to 18 000 rpm"
        if computed[name] is None
        else " < ".join(f"{law.thrust[c].speed_rpm:.0f}" for c in confs) + " rpm"
        for name, law in numbers.laws.items()
    }
    return of_laws(
        numbers,
        computed,
        lambda d: d > 0.0,
        f"{joined(speeds)}: that there is a maximum at all hangs on one disputed in-plane term of "
        "the twist.",
    )


@judges
def gamma_mtf(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the twist at maximum thrust is the same for every configuration."""
    return _same_twist(numbers, "thrust")


def _same_twist(numbers: Numbers, which: str) -> ClaimOutcome:
    optima: dict[str, Mapping[int, Optimum]] = {
        name: getattr(law, which) for name, law in numbers.laws.items()
    }
    computed = {name: _spread(found, "gamma_deg") for name, found in optima.items()}
    values = {
        name: "none"
        if computed[name] is None
        else f"{min(o.gamma_deg for o in found.values()):.2f}–"
        f"{max(o.gamma_deg for o in found.values()):.2f}°"
        for name, found in optima.items()
    }
    return of_laws(
        numbers,
        computed,
        lambda d: d < SAME_ANGLE_DEG,
        f"γ there: {joined(values)}; a theorem where there is a maximum, not an observation.",
        angle=f"{SAME_ANGLE_DEG:g}",
    )


def _spread(optima: Mapping[int, Optimum], name: str) -> float | None:
    """Return the largest difference between configurations, None unless all have a maximum."""
    if not all(o.inside for o in optima.values()):
        return None
    values = [getattr(o, name) for o in optima.values()]
    return float(max(values) - min(values))
