"""Claims about the flight experiment: its printed points and times, and the simulated campaign."""

from __future__ import annotations

import math
from collections.abc import Sequence

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

UNIT_VECTOR = 0.02
"""How far from one a unit vector's length may be, for points given to a centimetre."""
_CALIBRATED = "four unknowns of the simulation were calibrated on this (docs/calibration.md)"


@judges
def response_point(paper: Paper, _: Numbers) -> ClaimOutcome:
    """Judge whether x_r lies d_r from x_c, as printed."""
    distance = paper.number("flight", "bounce_m")
    found = _apart(
        paper.point("flight", "collision_point_m"), paper.point("flight", "response_point_m")
    )
    return of_data(
        found,
        holds_if(distance.agrees(found)),
        f"{found:.3f} m: {distance.text} m only as rounded; the points are printed to 0.1 m.",
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
    found = rate.value * time.value
    low, high = ((rate.value + s * rate.half) * (time.value + s * time.half) for s in (-1, 1))
    return of_data(
        found,
        holds_if(low <= falls.value + falls.half and falls.value - falls.half <= high),
        f"{rate.text} m/s × {time.text} s = {found:.2f} m, {low:.2f} to {high:.2f} m with "
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
