"""Claims about what was measured: collisions, recovery, wear, noise, and the flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from tombo_propeller.reproduce.paper_values import Paper, PrintedNumber

HINGE_MM = 29.0
"""Where the nodus bends: the middle of its 23 to 35 mm."""
UNIT_VECTOR = 0.02
"""How far from one a unit vector's length may be, for points given to a centimetre."""
_CALIBRATED = "four unknowns of the simulation were calibrated on this (docs/calibration.md)"


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
        place=paper.source("measured", "force_share_of_rigid"),
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


@judges
def response_point(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether x_r lies d_r from x_c, as printed."""
    distance = paper.number("flight", "bounce_m")
    apart = _apart(
        paper.point("flight", "collision_point_m"), paper.point("flight", "response_point_m")
    )
    return of_data(
        apart,
        holds_if(distance.agrees(apart)),
        f"{apart:.3f} m: {distance.text} m only as rounded; the points are printed to 0.1 m.",
        distance=distance.text,
    )


@judges
def response_equation(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge x_r = x_c + d_r n_r, in the numbers that were flown with."""
    flown = _apart(
        paper.point("program", "collision_point_m"), paper.point("program", "response_point_m")
    )
    length = flown / paper.number("flight", "bounce_m").value
    return of_data(
        length,
        holds_if(abs(length - 1.0) <= UNIT_VECTOR),
        f"The script's points are {flown:.3f} m apart, so |n_r| = {length:.3f}: x_r was chosen, "
        "not computed from the collision.",
        tolerance=f"{UNIT_VECTOR:g}",
    )


@judges
def recovery_phases(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether the phases of the recovery add up."""
    unstable, after = paper.number("flight", "unstable_s"), paper.number("flight", "recovery_s")
    total = unstable.value + after.value
    return of_data(
        total,
        holds_if(paper.number("flight", "whole_recovery_s").agrees(total)),
        f"{unstable.text} s + {after.text} s = {total:g} s.",
        unstable=unstable.text,
        after=after.text,
    )


@judges
def falling_distance(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Compare rate and duration of the fall with its distance."""
    rate, time = paper.number("flight", "falling_rate_m_s"), paper.number("flight", "unstable_s")
    falls = paper.number("flight", "falls_m")
    height = rate.value * time.value
    low, high = ((rate.value + s * rate.half) * (time.value + s * time.half) for s in (-1, 1))
    return of_data(
        height,
        holds_if(low <= falls.value + falls.half and falls.value - falls.half <= high),
        f"{rate.text} m/s × {time.text} s = {height:.2f} m, {low:.2f} to {high:.2f} m with "
        "rounding.",
    )


@judges
def recovers(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether the vehicle recovers with the reaction."""
    figures = ", ".join(
        f"{word} {paper.text('campaign', key)} {unit} ({paper.text('campaign', f'{key}_range')}; "
        f"paper {paper.text('flight', key)})"
        for word, key, unit in (
            ("falls", "falls_m", "m"),
            ("unstable", "unstable_s", "s"),
            ("recovers in", "whole_recovery_s", "s"),
        )
    )
    return _campaign(
        paper,
        "recovered",
        f"in the median (5 to 95 % of flights; the paper's value) it {figures}; but {_CALIBRATED}",
    )


@judges
def crashes_without_reaction(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether the vehicle crashes without the reaction."""
    return _campaign(
        paper,
        "crashed_without_reaction",
        f"but {_CALIBRATED}, and other obstacles give other verdicts",
    )


def _campaign(paper: Paper, name: str, but: str) -> ClaimOutcome:
    """Return the share of simulated flights that do: an experiment, so it never holds."""
    count, flights = paper.number("campaign", name), paper.number("campaign", "flights")
    share = 100.0 * count.value / flights.value
    return of_data(
        share,
        OPEN if share > 50.0 else FAILS,
        f"An experiment: {count.text} of {flights.text} simulated flights do, {but}.",
    )


def _apart(a: Sequence[PrintedNumber], b: Sequence[PrintedNumber]) -> float:
    return math.dist([p.value for p in a], [p.value for p in b])
