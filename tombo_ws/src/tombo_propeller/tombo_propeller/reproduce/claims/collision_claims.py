"""Claims about collisions, recovery, wear and noise: arithmetic on what was measured."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy import stats

from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    OPEN,
    ClaimOutcome,
    holds_if,
    judges,
    of_data,
)
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper

HINGE_MM = 29.0
"""Where the nodus bends: the middle of its 23 to 35 mm."""


@judges
def collision_force(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge the abstract's claim about collision force."""
    share = paper.text("measured", "force_share_of_rigid")
    above, below = share.split("/")
    bound = float(above) / float(below)
    rigid = paper.table_3[0].force_N.value
    shares = {c: r.force_N.value / rigid for c, r in paper.table_3.items() if c}
    worst = max(shares, key=lambda c: shares[c])
    within = sum(share < bound for share in shares.values())
    return of_data(
        shares[worst],
        holds_if(shares[worst] < bound),
        f"Conf. {worst}: {paper.table_3[worst].force_N.text} N of {rigid:g} N is "
        f"{shares[worst]:.3f}; {within} of {len(shares)} configurations are below {share}, "
        f"their mean is {np.mean(list(shares.values())):.2f}.",
        share=share,
        bound=f"{bound:.3f}",
        said=paper.source("measured", "force_share_of_rigid"),
    )


@judges
def collision_force_over_radius(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Compare Table II with a stiff wing on a hinge."""
    rows = sorted(paper.table_2, key=lambda row: row.r_mm.value)
    largest = max(rows, key=lambda row: row.force_N.value)
    wrong = [
        f"{a.r_mm.text} to {b.r_mm.text} mm"
        for a, b in pairwise(rows)
        if b.force_N.value > a.force_N.value
    ]
    outer, inner = rows[-1], largest
    hinged = _hinged(inner.r_mm.value) / _hinged(outer.r_mm.value)
    return of_data(
        largest.r_mm.value,
        holds_if(not wrong),
        f"Largest at {largest.r_mm.text} mm, {largest.force_N.text} N; "
        + (f"it rises from {', '.join(wrong)}; " if wrong else "")
        + f"outwards it falls {inner.force_N.value / outer.force_N.value:.1f}-fold, of which "
        f"leverage explains {hinged:.1f} and the thinner blade perhaps the rest.",
        radius=largest.r_mm.text,
    )


@judges
def collision_force_tables(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether both tables can be of the same propeller."""
    factor = paper.number("measured", "table_2_speed_rpm").value / (
        paper.number("model", "table_3_speed_rpm").value
    )
    force = paper.table_3[13].force_N.value
    forces = [row.force_N.value for row in paper.table_2]
    low, high = force * factor, force * factor**2
    return of_data(
        low,
        OPEN if min(forces) <= high and low <= max(forces) else FAILS,
        f"At 2500 rpm Table III's force would be {low:.0f} to {high:.0f} N, as Table II has it "
        "between 90 and 100 mm; where Table III's blades were struck is not in its data.",
        force=f"{force:g}",
        least=f"{min(forces):g}",
        most=f"{max(forces):g}",
    )


@judges
def mean_recovery_time(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge the mean of a column."""
    times = [r.recovery_s.value for r in paper.table_3.values() if r.recovery_s is not None]
    mean = math.fsum(times) / len(times)
    return of_data(
        mean,
        holds_if(paper.number("measured", "mean_recovery_s").agrees(mean)),
        f"{math.fsum(times):.2f} s / {len(times)} = {mean:.3f} s, between {min(times):g} and "
        f"{max(times):g} s.",
    )


@judges
def endurance(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge how many collisions a propeller endures."""
    trials = paper.number("measured", "trials").value
    replaced = paper.number("measured", "replaced").value
    mean = trials / replaced
    low = float(stats.beta.ppf(0.025, replaced, trials - replaced + 1.0))
    high = float(stats.beta.ppf(0.975, replaced + 1.0, trials - replaced))
    right = paper.number("measured", "collisions_a_propeller").agrees(mean)
    return of_data(
        mean,
        OPEN if right else FAILS,
        f"The arithmetic {'is right' if right else 'is wrong'}, {mean:.1f}, but {replaced:.0f} of "
        f"{trials:.0f} leaves anything from {1.0 / high:.1f} to {1.0 / low:.0f} collisions.",
        replaced=f"{replaced:.0f}",
        trials=f"{trials:.0f}",
    )


@judges
def noise(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Compare the noise with the rigid propeller's."""
    rigid = paper.table_3[0].noise_dB.value
    soft = np.array([r.noise_dB.value for c, r in paper.table_3.items() if c])
    apart = soft - rigid
    mean = float(apart.mean())
    half = float(stats.t.ppf(0.975, len(soft) - 1) * apart.std(ddof=1) / math.sqrt(len(soft)))
    return of_data(
        mean,
        FAILS if abs(mean) > half else OPEN,
        f"{mean:+.1f} ± {half:.1f} dB in the mean, {apart.min():+.1f} to {apart.max():+.1f} dB "
        "singly, against one rigid propeller without a printed scatter.",
        quietest=f"{soft.min():g}",
        loudest=f"{soft.max():g}",
        rigid=f"{rigid:g}",
    )


def _hinged(r_mm: float) -> float:
    """Return a hinged wing's collision force over radius, up to a factor.

    At radius r the blade comes with omega r and the inertia I / (r - hinge)^2, against a contact
    of one stiffness: force = omega r sqrt(k I) / (r - hinge).
    """
    return r_mm / (r_mm - HINGE_MM)
