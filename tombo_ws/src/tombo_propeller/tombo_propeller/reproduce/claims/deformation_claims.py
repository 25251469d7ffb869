"""The paper's reading of the flap from pictures, compared with what its model deforms."""

from __future__ import annotations

import math

from tombo_dynamics.propeller import configuration
from tombo_propeller.reproduce.claims.claim import (
    ClaimOutcome,
    by_law,
    judge_of,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

READING_DEG = 0.5


@judges
def beta_reading(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the formula with which the paper reads the flap from pictures."""

    def bias(law: LawNumbers) -> float:
        return max(
            (reading_deg(p.alpha_deg, p.beta_deg) - p.beta_deg
             for points in (law.low, law.high) for c, p in points.items() if c),
            key=abs,
        )  # fmt: skip

    computed = by_law(numbers, bias)
    return of_laws(
        numbers,
        computed,
        lambda e: abs(e) < READING_DEG,
        "Exact for flap alone, but lag shortens the diameter too; with the laws' α "
        f"{_thirteen(numbers)} at 2000 rpm, and the error "
        f"reaches {per_law(computed, '{:+.1f}°')}.",
        reading=f"{READING_DEG:g}",
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
