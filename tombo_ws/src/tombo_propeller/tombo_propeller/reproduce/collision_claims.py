"""Claims about collisions, recovery, wear and noise: arithmetic on what was measured."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy import stats

from tombo_propeller.reproduce.claim import DATA, FAILS, OPEN, Claim, holds_if
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper

HINGE_MM = 29.0
"""Where the nodus bends: the middle of its 23 to 35 mm."""


def two_thirds(paper: Paper, numbers: Numbers) -> Claim:
    """The abstract's claim about collision force."""
    above, below = paper.text("measured", "force_share_of_rigid").split("/")
    bound = float(above) / float(below)
    rigid = paper.table_3[0].force_N.value
    shares = {c: r.force_N.value / rigid for c, r in paper.table_3.items() if c}
    worst = max(shares, key=lambda c: shares[c])
    within = sum(share < bound for share in shares.values())
    return Claim(
        name="collision_force",
        group="Collision, recovery, noise",
        kind="stated",
        claim="The largest collision force is less than two-thirds of the rigid propeller's",
        source=f"{paper.source('measured', 'force_share_of_rigid')}; Table III",
        paper=f"< {above}/{below}",
        quantity="largest force of Conf. 5–13 over that of Conf. 0",
        unit="1",
        computed={DATA: shares[worst]},
        tolerance=f"below {bound:.3f}",
        verdicts={DATA: holds_if(shares[worst] < bound)},
        judge=DATA,
        evidence=f"Conf. {worst}: {paper.table_3[worst].force_N.text} N of {rigid:g} N is "
        f"{shares[worst]:.3f}; {within} of {len(shares)} configurations are below "
        f"{above}/{below}, their mean is {np.mean(list(shares.values())):.2f}.",
    )


def force_over_radius(paper: Paper, numbers: Numbers) -> Claim:
    """Table II against a stiff wing on a hinge."""
    rows = sorted(paper.table_2, key=lambda row: row.r_mm.value)
    largest = max(rows, key=lambda row: row.force_N.value)
    wrong = [
        f"{a.r_mm.text} to {b.r_mm.text} mm"
        for a, b in pairwise(rows)
        if b.force_N.value > a.force_N.value
    ]
    outer, inner = rows[-1], largest
    hinged = _hinged(inner.r_mm.value) / _hinged(outer.r_mm.value)
    return Claim(
        name="collision_force_over_radius",
        group="Collision, recovery, noise",
        kind="check",
        claim="Collision force falls towards the tip, as on a wing hinged at its nodus",
        source="Table II",
        paper=f"largest at {largest.r_mm.text} mm",
        quantity="radius of the largest force",
        unit="mm",
        computed={DATA: largest.r_mm.value},
        tolerance="force falls with every step outwards",
        verdicts={DATA: holds_if(not wrong)},
        judge=DATA,
        evidence=f"Largest at {largest.r_mm.text} mm, {largest.force_N.text} N; "
        + (f"it rises from {', '.join(wrong)}; " if wrong else "")
        + f"outwards it falls {inner.force_N.value / outer.force_N.value:.1f}-fold, of which "
        f"leverage explains {hinged:.1f} and the thinner blade perhaps the rest.",
    )


def tables_2_and_3(paper: Paper, numbers: Numbers) -> Claim:
    """Whether both tables can speak of the same propeller."""
    factor = paper.number("measured", "table_2_speed_rpm").value / (
        paper.number("model", "table_3_speed_rpm").value
    )
    force = paper.table_3[13].force_N.value
    forces = [row.force_N.value for row in paper.table_2]
    low, high = force * factor, force * factor**2
    return Claim(
        name="collision_force_tables",
        group="Collision, recovery, noise",
        kind="check",
        claim="Tables II and III agree on the force of Conf. 13",
        source="Tables II and III",
        paper=f"{force:g} N and {min(forces):g}–{max(forces):g} N",
        quantity="Table III's force carried over to Table II's speed with ω",
        unit="N",
        computed={DATA: low},
        tolerance="within Table II, force growing with ω to ω²",
        verdicts={DATA: OPEN if min(forces) <= high and low <= max(forces) else FAILS},
        judge=DATA,
        evidence=f"At 2500 rpm Table III's force would be {low:.0f} to {high:.0f} N, as Table II "
        "has it between 90 and 100 mm; where Table III's blades were struck is not in its data.",
    )


def mean_recovery(paper: Paper, numbers: Numbers) -> Claim:
    """The mean of a column."""
    printed = paper.number("measured", "mean_recovery_s")
    times = [r.recovery_s.value for r in paper.table_3.values() if r.recovery_s is not None]
    mean = math.fsum(times) / len(times)
    return Claim(
        name="mean_recovery_time",
        group="Collision, recovery, noise",
        kind="printed",
        claim="Mean recovery time of the nine propellers",
        source=paper.source("measured", "mean_recovery_s"),
        paper=f"{printed.text} s",
        quantity="mean of Table III's column",
        unit="s",
        computed={DATA: mean},
        tolerance="to the last printed digit",
        verdicts={DATA: holds_if(printed.agrees(mean))},
        judge=DATA,
        evidence=f"{math.fsum(times):.2f} s / {len(times)} = {mean:.3f} s, between {min(times):g} "
        f"and {max(times):g} s.",
    )


def endurance(paper: Paper, numbers: Numbers) -> Claim:
    """About three collisions per propeller."""
    trials = paper.number("measured", "trials").value
    replaced = paper.number("measured", "replaced").value
    said = paper.number("measured", "collisions_a_propeller")
    mean = trials / replaced
    low = float(stats.beta.ppf(0.025, replaced, trials - replaced + 1.0))
    high = float(stats.beta.ppf(0.975, replaced + 1.0, trials - replaced))
    right = said.agrees(mean)
    return Claim(
        name="endurance",
        group="Collision, recovery, noise",
        kind="stated",
        claim="A propeller endures about three collisions",
        source=paper.source("measured", "collisions_a_propeller"),
        paper=f"{said.text}: {replaced:.0f} replaced in {trials:.0f} trials",
        quantity="trials for each propeller replaced",
        unit="1",
        computed={DATA: mean},
        tolerance="to the printed digit; 95 % interval of a share",
        verdicts={DATA: OPEN if right else FAILS},
        judge=DATA,
        evidence=f"The arithmetic {'is right' if right else 'is wrong'}, {mean:.1f}, but "
        f"{replaced:.0f} of {trials:.0f} leaves anything from {1.0 / high:.1f} to {1.0 / low:.0f} "
        "collisions.",
    )


def noise(paper: Paper, numbers: Numbers) -> Claim:
    """Noise beside the rigid propeller's."""
    rigid = paper.table_3[0].noise_dB.value
    soft = np.array([r.noise_dB.value for c, r in paper.table_3.items() if c])
    apart = soft - rigid
    mean = float(apart.mean())
    half = float(stats.t.ppf(0.975, len(soft) - 1) * apart.std(ddof=1) / math.sqrt(len(soft)))
    return Claim(
        name="noise",
        group="Collision, recovery, noise",
        kind="check",
        claim="Tombo propellers are as loud as the rigid one",
        source="Table III",
        paper=f"{soft.min():g}–{soft.max():g} dB and {rigid:g} dB",
        quantity="mean of Conf. 5–13 less Conf. 0",
        unit="dB",
        computed={DATA: mean},
        tolerance="95 % interval of the mean",
        verdicts={DATA: FAILS if abs(mean) > half else OPEN},
        judge=DATA,
        evidence=f"{mean:+.1f} ± {half:.1f} dB in the mean, {apart.min():+.1f} to "
        f"{apart.max():+.1f} dB singly, against one rigid propeller without a printed scatter.",
    )


def _hinged(r_mm: float) -> float:
    """Return a hinged wing's collision force over radius, up to a factor.

    At radius r the blade comes with omega r and the inertia I / (r - hinge)^2, against a contact
    of one stiffness: force = omega r sqrt(k I) / (r - hinge).
    """
    return r_mm / (r_mm - HINGE_MM)


COLLISION_CLAIMS = (
    two_thirds,
    force_over_radius,
    tables_2_and_3,
    mean_recovery,
    endurance,
    noise,
)
