"""Claims about what was measured: collisions, recovery, wear, noise, and the flight."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy import stats

from tombo_propeller.reproduce.claims.claim import FAILS, OPEN, ClaimResult, holds_if, judges
from tombo_propeller.reproduce.paper_values import Paper

HINGE_MM = 29.0
"""Where the nodus bends: the middle of its 23 to 35 mm."""
UNIT_VECTOR = 0.02
"""How far from one a unit vector's length may be, for points given to a centimetre."""


@judges
def collision_force(paper: Paper) -> ClaimResult:
    """Judge the abstract's claim about collision force."""
    share = paper.text("measured", "force_share_of_rigid")
    above, below = share.split("/")
    bound = float(above) / float(below)
    rigid = paper.table_3[0].force_N.value
    shares = {c: paper.table_3[c].force_N.value / rigid for c in paper.soft}
    conf = max(shares, key=lambda c: shares[c])
    return ClaimResult(
        shares[conf],
        holds_if(shares[conf] < bound),
        {
            "share": share,
            "bound": bound,
            "place": paper.source("measured", "force_share_of_rigid"),
            "conf": conf,
            "force": paper.table_3[conf].force_N,
            "rigid": rigid,
            "largest": shares[conf],
            "within": sum(share < bound for share in shares.values()),
            "count": len(shares),
            "mean": np.mean(list(shares.values())),
        },
    )


@judges
def collision_force_over_radius(paper: Paper) -> ClaimResult:
    """Compare Table II with a stiff wing on a hinge."""
    rows = sorted(paper.table_2, key=lambda row: row.r_mm.value)
    inner, outer = max(rows, key=lambda row: row.force_N.value), rows[-1]
    wrong = ", ".join(
        f"{a.r_mm.text} to {b.r_mm.text} mm"
        for a, b in pairwise(rows)
        if b.force_N.value > a.force_N.value
    )
    return ClaimResult(
        inner.r_mm.value,
        holds_if(not wrong),
        {
            "radius": inner.r_mm,
            "force": inner.force_N,
            "rises": f"it rises from {wrong}; " if wrong else "",
            "fold": inner.force_N.value / outer.force_N.value,
            "hinged": _hinged(inner.r_mm.value) / _hinged(outer.r_mm.value),
        },
    )


def _hinged(r_mm: float) -> float:
    """Return a hinged wing's collision force over radius, up to a factor.

    At radius r the blade comes with omega r and the inertia I / (r - hinge)^2, against a contact
    of one stiffness: force = omega r sqrt(k I) / (r - hinge).
    """
    return r_mm / (r_mm - HINGE_MM)


@judges
def collision_force_tables(paper: Paper) -> ClaimResult:
    """Judge whether both tables can be of the same propeller."""
    faster = paper.number("measured", "table_2_speed_rpm").value
    factor = faster / paper.number("model", "table_3_speed_rpm").value
    force = paper.table_3[13].force_N.value
    forces = [row.force_N.value for row in paper.table_2]
    low, high = force * factor, force * factor**2
    texts = {"force": force, "least": min(forces), "most": max(forces), "low": low, "high": high}
    return ClaimResult(low, OPEN if min(forces) <= high and low <= max(forces) else FAILS, texts)


@judges
def mean_recovery_time(paper: Paper) -> ClaimResult:
    """Judge the mean of a column."""
    times = [r.recovery_s.value for r in paper.table_3.values() if r.recovery_s is not None]
    total = math.fsum(times)
    mean = total / len(times)
    texts = {"total": total, "count": len(times), "mean": mean}
    texts |= {"least": min(times), "most": max(times)}
    holds = holds_if(paper.number("measured", "mean_recovery_s").agrees(mean))
    return ClaimResult(mean, holds, texts)


@judges
def endurance(paper: Paper) -> ClaimResult:
    """Judge how many collisions a propeller endures."""
    trials = paper.number("measured", "trials").value
    replaced = paper.number("measured", "replaced").value
    mean = trials / replaced
    low = float(stats.beta.ppf(0.025, replaced, trials - replaced + 1.0))
    high = float(stats.beta.ppf(0.975, replaced + 1.0, trials - replaced))
    right = paper.number("measured", "collisions_a_propeller").agrees(mean)
    texts: dict[str, object] = {"replaced": replaced, "trials": trials, "mean": mean}
    texts |= {"least": 1.0 / high, "most": 1.0 / low}
    texts["right"] = "is right" if right else "is wrong"
    return ClaimResult(mean, OPEN if right else FAILS, texts)


@judges
def noise(paper: Paper) -> ClaimResult:
    """Compare the noise with the rigid propeller's."""
    rigid = paper.table_3[0].noise_dB.value
    soft = np.array([paper.table_3[c].noise_dB.value for c in paper.soft])
    apart = soft - rigid
    mean = float(apart.mean())
    half = float(stats.t.ppf(0.975, len(soft) - 1) * apart.std(ddof=1) / math.sqrt(len(soft)))
    texts = {"quietest": soft.min(), "loudest": soft.max(), "rigid": rigid, "mean": mean}
    texts |= {"half": half, "least": apart.min(), "most": apart.max()}
    return ClaimResult(mean, FAILS if abs(mean) > half else OPEN, texts)


@judges
def response_point(paper: Paper) -> ClaimResult:
    """Judge whether x_r lies d_r from x_c, as printed."""
    distance, apart = paper.number("flight", "bounce_m"), _response_distance(paper, "flight")
    return ClaimResult(
        apart, holds_if(distance.agrees(apart)), {"distance": distance, "apart": apart}
    )


@judges
def response_equation(paper: Paper) -> ClaimResult:
    """Judge x_r = x_c + d_r n_r, in the numbers that were flown with."""
    flown = _response_distance(paper, "program")
    length = flown / paper.number("flight", "bounce_m").value
    texts = {"flown": flown, "length": length, "tolerance": UNIT_VECTOR}
    return ClaimResult(length, holds_if(abs(length - 1.0) <= UNIT_VECTOR), texts)


def _response_distance(paper: Paper, section: str) -> float:
    """Return |x_r - x_c| [m] of the points in a section of `paper.yaml`."""
    points = (paper.point(section, f"{name}_point_m") for name in ("collision", "response"))
    return math.dist(*([p.value for p in point] for point in points))


@judges
def recovery_phases(paper: Paper) -> ClaimResult:
    """Judge whether the phases of the recovery add up."""
    unstable, after = paper.number("flight", "unstable_s"), paper.number("flight", "recovery_s")
    total = unstable.value + after.value
    return ClaimResult(
        total,
        holds_if(paper.number("flight", "whole_recovery_s").agrees(total)),
        {"unstable": unstable, "after": after, "total": total},
    )


@judges
def falling_distance(paper: Paper) -> ClaimResult:
    """Compare rate and duration of the fall with its distance."""
    rate, time = paper.number("flight", "falling_rate_m_s"), paper.number("flight", "unstable_s")
    falls = paper.number("flight", "falls_m")
    height = rate.value * time.value
    low, high = ((rate.value + s * rate.half) * (time.value + s * time.half) for s in (-1, 1))
    within = low <= falls.value + falls.half and falls.value - falls.half <= high
    texts = {"rate": rate, "time": time, "height": height, "low": low, "high": high}
    return ClaimResult(height, holds_if(within), texts)


@judges
def recovers(paper: Paper) -> ClaimResult:
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
    return _campaign(paper, "recovered", figures)


@judges
def crashes_without_reaction(paper: Paper) -> ClaimResult:
    """Judge whether the vehicle crashes without the reaction."""
    return _campaign(paper, "crashed_without_reaction", "")


def _campaign(paper: Paper, name: str, figures: str) -> ClaimResult:
    """Return the share of simulated flights that do: an experiment, so it never holds."""
    count, flights = paper.number("campaign", name), paper.number("campaign", "flights")
    share = 100.0 * count.value / flights.value
    texts = {"count": count, "flights": flights, "figures": figures}
    return ClaimResult(share, OPEN if share > 50.0 else FAILS, texts)
