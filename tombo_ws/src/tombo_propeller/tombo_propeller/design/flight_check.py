"""The recommendation: the first candidate that flies the paper's collision as it is claimed to."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tombo_bag.flight import Flight
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import TICK_S
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.process.study import fly_seeds
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_files import scenario_of, write_flyable
from tombo_propeller.design.request import NAMES
from tombo_sim.flight_setup import begin

FIRST_SEED = 0
_STRIKE_TICKS = 30
_THRUST_BACK = 0.9
"""Share of thrust at which a blade counts as recovered, as effects/strike.py reads Table III."""
_CLOSE = 0.02
"""Share by which a claimed figure and a simulated one may differ."""
_LEFT_OUT = 3.0
"""Standard errors that the scatter of thrust may move the mean speed in hover by."""
MOST_FLOWN = 8
"""Largest number of candidates that are flown."""
_MORE = 1.05
"""After a failure only a candidate with this much more thrust, or another strike, is flown."""


@dataclass(frozen=True)
class FigureCheck:
    """One figure, claimed and simulated."""

    text: str
    claimed: float
    simulated: float
    unit: str
    held: bool


@dataclass(frozen=True)
class Check:
    """The collision flown with several seeds; the fields are those of `design.json`."""

    flights: int
    collision_force_N: float
    """Collision force and recovery time that were flown with."""
    recovery_s: float
    largest_fall_m: float
    """Largest fall of all flights; NaN if none touches."""
    longest_settling_s: float
    """Time from touch to rest at x_r; NaN if none comes to rest."""
    limits: tuple[FigureCheck, ...]
    """The limits that flights can confirm, with their figures."""
    claims: tuple[FigureCheck, ...]

    @property
    def flies(self) -> bool:
        """Whether it flies as claimed, whatever the limits."""
        return all(claim.held for claim in self.claims)

    @property
    def held(self) -> bool:
        """Whether all claims are met and the limits kept."""
        return self.flies and all(limit.held for limit in self.limits)


@dataclass(frozen=True)
class Recommendation:
    """The recommended candidate, and its flights."""

    index: int | None
    """Index of the candidate; None: none keeps to the limits and recovers."""
    check: Check | None
    """Its flights; None without flights."""
    failed: tuple[tuple[int, Check], ...]
    """Candidates that keep to the limits but not to their claims in flight."""
    unflown: int = 0
    """Feasible candidates that were not flown: too many failed, or one like them did."""


def recommend(
    design: Design, seeds: Sequence[int], on_progress: ProgressCallback = no_progress
) -> Recommendation:
    """Fly the feasible candidates in their order until one keeps its claims.

    Args:
        design: the design.
        seeds: of each candidate's flights; without any nothing is flown.
        on_progress: called with the progress.
    """
    order = design.choice.order
    if not order or not seeds:
        return Recommendation(order[0] if order else None, None, ())
    failed: list[tuple[int, Check]] = []
    for index in order:
        if len(failed) >= MOST_FLOWN:
            break
        if any(_alike(design, index, other) for other, _ in failed):
            continue
        check = check_design(design, index, seeds, on_progress)
        if check.held:
            return Recommendation(index, check, tuple(failed))
        failed.append((index, check))
    return Recommendation(None, None, tuple(failed), len(order) - len(failed))


def _alike(design: Design, one: int, other: int) -> bool:
    """Return whether a candidate would do no better than one that failed.

    It would if its blades are struck alike, and it has hardly more thrust.
    """
    a, b = design.evaluated.value[one], design.evaluated.value[other]
    same = bool((abs(a[1:3] - b[1:3]) <= 1e-9).all())
    return same and bool(a[0] <= _MORE * b[0])


def check_design(
    design: Design, index: int, seeds: Sequence[int], on_progress: ProgressCallback = no_progress
) -> Check:
    """Fly the collision with a candidate and hold its claims against the flights.

    Args:
        design: the design.
        index: of the candidate.
        seeds: of the flights; one at least.
        on_progress: called with the progress.

    Raises:
        InputError: the simulator refuses the vehicle.
    """
    configuration = design.evaluated.configurations[index]
    force, recovery = strike_of(design, index)
    values = scenario_of(design.request, configuration, force, recovery)
    with tempfile.TemporaryDirectory(prefix="tombo-design-") as folder:
        scenario = load_scenario(str(write_flyable(Path(folder), values, configuration)))
        flown = _fly(scenario, seeds, on_progress)
        margin, scatter = _table(scenario)
    claims = _claims(design, index, flown, margin, scatter)
    simulated = {name: claim.simulated for name, claim in zip(_SHOWN, claims, strict=True)}
    fall, settling = (float(np.fmax.reduce(flown[name])) for name in ("falls_m", "settles_s"))
    limits = _limits(design, simulated)
    return Check(len(seeds), force, recovery, fall, settling, limits, claims)


def _fly(
    scenario: Scenario, seeds: Sequence[int], on_progress: ProgressCallback
) -> dict[str, Array]:
    """Return the figures of flights with each of the seeds, (n,) each, NaN where there is none.

    Raises:
        InputError: one can't be flown.
    """
    stage = f"flying {len(seeds)} collisions"
    on_progress(stage, 0.0)
    warm_up_flight(scenario)
    rows = fly_seeds(
        scenario, seeds, _figures, progress=lambda done: on_progress(stage, done / len(seeds))
    )
    for row in rows.values():
        if "error" in row:
            raise InputError(row["error"])
    names = next(iter(rows.values()))
    return {name: np.array([row[name] for row in rows.values()], dtype=float) for name in names}


def _figures(flight: Flight) -> dict[str, Any]:
    """Return the claims that a flight confirms or refutes."""
    log, summary = flight.log, flight.summary
    hovering = log["mode"][:, 0] == Phase.HOVER
    blade = (log["contact"][:, 0] > 0.0) & (log["contact"][:, 1] >= 0.0)
    first = int(blade.argmax())  # later two blades may be struck at once
    push = np.linalg.norm(log["contact_force"][first : first + _STRIKE_TICKS], axis=1)
    settles = summary["recovery_time_s"]
    return {
        "collided": bool(summary["collided"]),
        "recovered": not summary["crashed"] and settles is not None,
        "hover_speed": float(log["rotor_speed"][hovering].mean()) if hovering.any() else math.nan,
        "force_N": float(push.max()) if blade.any() else math.nan,
        "recovery_s": blade_recovery(log["fold"]),
        "falls_m": summary["max_falling_distance_m"],
        "settles_s": settles,
    }


def blade_recovery(fold: Array) -> float:
    """Return the longest time [s] from a folded blade's release until 90 % of thrust are back.

    Releases after which the blade is struck again are left out. NaN if there is none.

    Args:
        fold: (n, 4) fold of each blade in every tick, 0 straight to 1 folded.
    """
    longest = math.nan
    for blade in fold.T:
        ends = np.flatnonzero((blade[:-1] >= 1.0 - 1e-9) & (blade[1:] < 1.0 - 1e-9))
        for k, end in enumerate(ends):
            until = int(ends[k + 1]) if k + 1 < ends.size else blade.size
            after = blade[end + 1 : until]
            back = np.flatnonzero((1.0 - after) ** 3 >= _THRUST_BACK)
            rises = np.flatnonzero(np.diff(after) > 0.0)
            if back.size and not (rises.size and rises[0] < back[0]):
                longest = float(np.fmax(longest, (back[0] + 1) * TICK_S))
    return longest


def _claims(
    design: Design, index: int, flown: dict[str, Array], margin: float, scatter: float
) -> tuple[FigureCheck, ...]:
    count = len(flown["collided"])
    collided, recovered = (int(flown[name].sum()) for name in ("collided", "recovered"))
    force, recovery = strike_of(design, index)
    hover = float(design.evaluated.operating.hover_speed[index])
    speeds = flown["hover_speed"][np.isfinite(flown["hover_speed"])].tolist()
    speed = sum(speeds) / len(speeds) if speeds else math.nan
    # Speed goes with the root of thrust; every flight draws four rotors.
    drift = _CLOSE + _LEFT_OUT * 0.5 * scatter / math.sqrt(4.0 * count)
    claimed = float(design.evaluated.value[index, NAMES.index("thrust_margin")])
    push, back = (float(np.fmax.reduce(flown[name])) for name in ("force_N", "recovery_s"))
    rpm = 30.0 / math.pi
    in_margin = abs(margin - claimed) <= _CLOSE * abs(claimed)
    in_time = abs(back - recovery) <= _CLOSE * recovery + 2.0 * TICK_S
    rows = (
        ("flights that touch the pillar", count, collided, "", collided == count),
        ("flights that recover after it", count, recovered, "", recovered == count),
        ("thrust margin", claimed, margin, "", in_margin),
        ("rotor speed in hover", hover * rpm, speed * rpm, "rpm",
         abs(speed - hover) <= drift * hover),
        ("first strike's highest force", force, push, "N", push <= force * (1.0 + _CLOSE)),
        ("blade's recovery time", recovery, back, "s", in_time),
    )  # fmt: skip
    return tuple(FigureCheck(*row) for row in rows)


_SHOWN = ("", "", "thrust_margin", "", "collision_force_N", "recovery_s")
"""What each claim says of a quantity, in their order."""


def _limits(design: Design, simulated: dict[str, float]) -> tuple[FigureCheck, ...]:
    kept = []
    for limit in design.choice.limits:
        if limit.quantity.name in simulated:
            value = simulated[limit.quantity.name]
            slack = (value - limit.value) * (1.0 if limit.quantity.more_is_better else -1.0)
            held = slack >= -1e-3 * limit.value
            kept.append(FigureCheck(limit.text, limit.value, value, limit.quantity.unit, held))
    return tuple(kept)


def strike_of(design: Design, index: int) -> tuple[float, float]:
    """Return collision force [N] and recovery time [s], of a prediction the upper end."""
    high = design.evaluated.high[index]
    return float(high[NAMES.index("collision_force_N")]), float(high[NAMES.index("recovery_s")])


def _table(scenario: Scenario) -> tuple[float, float]:
    """Return the thrust margin in the simulator's own table, and the scatter of thrust."""
    setup = begin(world_of(scenario), FIRST_SEED)
    margin = float(setup.maps.thrust_highest) / scenario.vehicle.hover_thrust()
    return margin, setup.effects["thrust_scatter"]["deviation"]
