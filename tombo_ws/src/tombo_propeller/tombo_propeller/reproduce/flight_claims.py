"""Claims about the flight experiment: its printed points and times, and the simulated campaign."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tombo_propeller.reproduce.claim import DATA, FAILS, OPEN, Claim, holds_if
from tombo_propeller.reproduce.computed_values import Numbers
from tombo_propeller.reproduce.paper_values import Paper, PrintedNumber

UNIT_VECTOR = 0.02
"""How far from one a unit vector's length may be, for points given to a centimetre."""
_CALIBRATED = "four unknowns of the simulation were calibrated on this (docs/calibration.md)"


def response_point(paper: Paper, numbers: Numbers) -> Claim:
    """x_r lies d_r from x_c, as printed."""
    printed = paper.number("flight", "bounce_m")
    found = _apart(
        paper.point("flight", "collision_point_m"), paper.point("flight", "response_point_m")
    )
    return Claim(
        name="response_point",
        group="Flight",
        kind="printed",
        claim="The printed x_r lies d_r from the printed x_c",
        source=paper.source("flight", "response_point_m"),
        paper=f"{printed.text} m",
        quantity="|x_r − x_c| of the printed points",
        unit="m",
        computed={DATA: found},
        tolerance="to the last printed digit",
        verdicts={DATA: holds_if(printed.agrees(found))},
        judge=DATA,
        evidence=f"{found:.3f} m: {printed.text} m only as rounded; the points are printed to "
        "0.1 m.",
    )


def response_equation(paper: Paper, numbers: Numbers) -> Claim:
    """x_r = x_c + d_r n_r, in the numbers that were flown with."""
    bounce = paper.number("flight", "bounce_m").value
    flown = _apart(
        paper.point("program", "collision_point_m"), paper.point("program", "response_point_m")
    )
    length = flown / bounce
    return Claim(
        name="response_equation",
        group="Flight",
        kind="check",
        claim="The flight's x_r is x_c + d_r n_r with a unit vector n_r",
        source="authors' flight script",
        paper="|n_r| = 1",
        quantity="|n_r| with d_r as printed",
        unit="1",
        computed={DATA: length},
        tolerance=f"{UNIT_VECTOR:g}: the script's points are given to 1 cm or finer",
        verdicts={DATA: holds_if(abs(length - 1.0) <= UNIT_VECTOR)},
        judge=DATA,
        evidence=f"The script's points are {flown:.3f} m apart, so |n_r| = {length:.3f}: x_r was "
        "chosen, not computed from the collision.",
    )


def phases(paper: Paper, numbers: Numbers) -> Claim:
    """The phases of the recovery add up."""
    unstable, after = paper.number("flight", "unstable_s"), paper.number("flight", "recovery_s")
    whole = paper.number("flight", "whole_recovery_s")
    total = unstable.value + after.value
    return Claim(
        name="recovery_phases",
        group="Flight",
        kind="printed",
        claim="Unstable phase and recovery phase make the mean recovery time",
        source=paper.source("flight", "whole_recovery_s"),
        paper=f"{unstable.text} + {after.text} = {whole.text} s",
        quantity="sum of the phases",
        unit="s",
        computed={DATA: total},
        tolerance="to the last printed digit",
        verdicts={DATA: holds_if(whole.agrees(total))},
        judge=DATA,
        evidence=f"{unstable.text} s + {after.text} s = {total:g} s.",
    )


def falling(paper: Paper, numbers: Numbers) -> Claim:
    """Rate and duration of the fall against its distance."""
    rate, time = paper.number("flight", "falling_rate_m_s"), paper.number("flight", "unstable_s")
    falls = paper.number("flight", "falls_m")
    found = rate.value * time.value
    low, high = ((rate.value + s * rate.half) * (time.value + s * time.half) for s in (-1, 1))
    fits = low <= falls.value + falls.half and falls.value - falls.half <= high
    return Claim(
        name="falling_distance",
        group="Flight",
        kind="check",
        claim="Observed falling rate and unstable phase give the falling distance",
        source=paper.source("flight", "falls_m"),
        paper=f"{falls.text} m",
        quantity="rate × unstable phase",
        unit="m",
        computed={DATA: found},
        tolerance="within the rounding of the three",
        verdicts={DATA: holds_if(fits)},
        judge=DATA,
        evidence=f"{rate.text} m/s × {time.text} s = {found:.2f} m, {low:.2f} to {high:.2f} m "
        "with rounding.",
    )


def recovers(paper: Paper, numbers: Numbers) -> Claim:
    """With the reaction the vehicle recovers."""
    share, flights = paper.number("campaign", "recovered"), paper.number("campaign", "flights")
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
        "recovers",
        "With the reaction the vehicle recovers",
        "yes",
        share,
        flights,
        f"in the median (5 to 95 % of flights; the paper's value) it {figures}; but {_CALIBRATED}",
    )


def crashes(paper: Paper, numbers: Numbers) -> Claim:
    """Without the reaction it crashes."""
    share = paper.number("campaign", "crashed_without_reaction")
    return _campaign(
        "crashes_without_reaction",
        "Without the reaction the vehicle falls to the ground",
        "crashes",
        share,
        paper.number("campaign", "flights"),
        f"but {_CALIBRATED}, and other obstacles give other verdicts",
    )


def _campaign(
    name: str, claim: str, paper: str, count: PrintedNumber, flights: PrintedNumber, but: str
) -> Claim:
    share = 100.0 * count.value / flights.value
    return Claim(
        name=name,
        group="Flight",
        kind="stated",
        claim=claim,
        source="flight experiment",
        paper=paper,
        quantity="simulated flights in which it does",
        unit="%",
        computed={DATA: share},
        tolerance="–",
        verdicts={DATA: OPEN if share > 50.0 else FAILS},
        judge=DATA,
        evidence=f"An experiment: {count.text} of {flights.text} simulated flights do, {but}.",
    )


def _apart(a: Sequence[PrintedNumber], b: Sequence[PrintedNumber]) -> float:
    return math.dist([p.value for p in a], [p.value for p in b])


FLIGHT_CLAIMS = (
    response_point,
    response_equation,
    phases,
    falling,
    recovers,
    crashes,
)
