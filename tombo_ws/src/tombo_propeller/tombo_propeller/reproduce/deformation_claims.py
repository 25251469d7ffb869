"""The paper's reading of the flap from pictures, held against what its model deforms."""

from __future__ import annotations

import math

from tombo_dynamics.propeller import configuration
from tombo_propeller.reproduce.claim import Claim, by_law, each, judge_of, verdicts
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

READING_DEG = 0.5


def beta_reading(paper: Paper, numbers: Numbers) -> Claim:
    """The formula with which the paper reads the flap from pictures."""

    def bias(law: LawNumbers) -> float:
        return max(
            (reading_deg(p.alpha_deg, p.beta_deg) - p.beta_deg
             for points in (law.low, law.high) for c, p in points.items() if c),
            key=abs,
        )  # fmt: skip

    computed = by_law(numbers, bias)
    return Claim(
        name="beta_reading",
        group="Deformation",
        kind="check",
        claim="β = acos((r_d − r_N)/(r − r_N)) reads the flap from the picture's diameter",
        source="figure caption",
        paper="formula",
        quantity="largest error of the reading, Conf. 1–13 at 2000 and 3200 rpm",
        unit="deg",
        computed=computed,
        tolerance=f"{READING_DEG:g} deg",
        verdicts=verdicts(computed, lambda e: abs(e) < READING_DEG),
        judge=judge_of(numbers),
        evidence="Exact for flap alone, but lag shortens the diameter too; with the laws' α "
        f"{_thirteen(numbers)} at 2000 rpm, and the error reaches "
        f"{each(computed, '{:+.1f}°')}.",
    )


def reading_deg(alpha_deg: float, beta_deg: float) -> float:
    """Return what the paper's formula reads [deg] where a wing has lag and flap."""
    joint = configuration(13).blade
    inner, length = joint.joint.outer_radius_m, joint.tip_radius_m - joint.joint.outer_radius_m
    alpha, beta = math.radians(alpha_deg), math.radians(beta_deg)
    seen = math.hypot(
        inner + length * math.cos(alpha) * math.cos(beta),
        length * math.sin(alpha) * math.cos(beta),
    )
    return math.degrees(math.acos(max(-1.0, min(1.0, (seen - inner) / length))))


def _thirteen(numbers: Numbers) -> str:
    law = numbers.laws[judge_of(numbers)]
    point = law.low[13]
    read = reading_deg(point.alpha_deg, point.beta_deg)
    return f"Conf. 13 with β = {point.beta_deg:.1f}° reads {read:.1f}° (law {law.law})"


DEFORMATION_CLAIMS = (beta_reading,)
