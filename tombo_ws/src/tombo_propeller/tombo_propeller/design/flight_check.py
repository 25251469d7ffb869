"""The recommended nodus in the paper's collision flight: claimed against simulated."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
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


@dataclass(frozen=True)
class Claim:
    """One figure, claimed and simulated."""

    text: str
    claimed: float
    simulated: float
    unit: str
    held: bool


@dataclass(frozen=True)
class Check:
    """The collision flown with several seeds."""

    seeds: tuple[int, ...]
    claims: tuple[Claim, ...]
    force_N: float
    """Collision force and recovery time that were flown with."""
    recovery_s: float
    falls_m: float | None
    """Largest falling distance of all flights."""
    settles_s: float | None
    """Longest time from touch to rest at x_r."""

    limits: tuple[Claim, ...]
    """The limits that flights can show, with what they show."""

    @property
    def flies(self) -> bool:
        """Whether it flies as claimed, whatever the limits."""
        return all(claim.held for claim in self.claims)

    @property
    def held(self) -> bool:
        """Whether all claims are met and the limits kept."""
        return self.flies and all(limit.held for limit in self.limits)


def check_design(
    found: Design,
    index: int,
    seeds: Sequence[int],
    *,
    upper: bool = False,
    on_progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Check:
    """Fly the collision with a candidate and hold its claims against the flights.

    Args:
        found: the design.
        index: of the candidate.
        seeds: of the flights; one at least.
        upper: with the upper ends of the predictions from all readings in place of a reading, as
            if the next propeller of the kind were any other one.
        on_progress: called with the progress.

    Raises:
        InputError: the simulator refuses the vehicle.
    """
    configuration = found.judged.configurations[index]
    force, recovery = (_flown(found, index, n, upper) for n in ("collision_force_N", "recovery_s"))
    values = scenario_of(found.request, configuration, force, recovery)
    with tempfile.TemporaryDirectory(prefix="tombo-design-") as folder:
        scenario = load_scenario(str(write_flyable(Path(folder), values, configuration)))
        flights = _fly(scenario, seeds, on_progress)
        margin, scatter = _table(scenario)
    claims = _claims(found, index, flights, margin, scatter, force, recovery)
    return Check(
        tuple(seeds),
        claims,
        force,
        recovery,
        _largest([f.falls_m for f in flights]),
        _largest([f.settles_s for f in flights]),
        _limits(
            found, {name: claim.simulated for name, claim in zip(_SHOWN, claims, strict=True)}
        ),
    )


def _fly(
    scenario: Scenario, seeds: Sequence[int], on_progress: Callable[[str, float], None]
) -> list[_Flown]:
    """Fly with each of the seeds.

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
    return [_Flown(**row) for row in rows.values()]


def _figures(flight: Flight) -> dict[str, Any]:
    return asdict(_Flown.of(flight.summary, flight.log))


@dataclass(frozen=True)
class _Flown:
    """What a flight shows of the claims."""

    collided: bool
    recovered: bool
    hover_speed: float
    force_N: float
    recovery_s: float
    falls_m: float | None
    settles_s: float | None

    @staticmethod
    def of(summary: Mapping[str, Any], log: Mapping[str, Array]) -> _Flown:
        hovering = log["mode"][:, 0] == Phase.HOVER
        speed = float(log["rotor_speed"][hovering].mean()) if hovering.any() else math.nan
        blade = (log["contact"][:, 0] > 0.0) & (log["contact"][:, 1] >= 0.0)
        first = int(blade.argmax())  # later two blades may be struck at once
        push = np.linalg.norm(log["contact_force"][first : first + _STRIKE_TICKS], axis=1)
        settles = summary["recovery_time_s"]
        return _Flown(
            bool(summary["collided"]),
            not summary["crashed"] and settles is not None,
            speed,
            float(push.max()) if blade.any() else math.nan,
            blade_recovery(log["fold"]),
            summary["max_falling_distance_m"],
            settles,
        )


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
    found: Design,
    index: int,
    flights: Sequence[_Flown],
    margin: float,
    scatter: float,
    force: float,
    recovery: float,
) -> tuple[Claim, ...]:
    count = len(flights)
    hover = float(found.judged.operating.hover_speed[index])
    flown = _mean([f.hover_speed for f in flights])
    # Speed goes with the root of thrust; every flight draws four rotors.
    drift = _CLOSE + _LEFT_OUT * 0.5 * scatter / math.sqrt(4.0 * count)
    claimed = float(found.judged.value[index, NAMES.index("thrust_margin")])
    push = _most([f.force_N for f in flights])
    back = _most([f.recovery_s for f in flights])
    rpm = 30.0 / math.pi
    return (
        Claim("flights that touch the pillar", count, sum(f.collided for f in flights), "",
              all(f.collided for f in flights)),
        Claim("flights that recover after it", count, sum(f.recovered for f in flights), "",
              all(f.recovered for f in flights)),
        Claim("thrust margin", claimed, margin, "",
              _near(margin, claimed)),
        Claim("rotor speed in hover", hover * rpm, flown * rpm, "rpm",
              abs(flown - hover) <= drift * hover),
        Claim("first strike's highest force", force, push, "N", push <= force * (1.0 + _CLOSE)),
        Claim("blade's recovery time", recovery, back, "s",
              abs(back - recovery) <= _CLOSE * recovery + 2.0 * TICK_S),
    )  # fmt: skip


_SHOWN = ("", "", "thrust_margin", "", "collision_force_N", "recovery_s")
"""What each claim says of a quantity, in their order."""


def _limits(found: Design, simulated: dict[str, float]) -> tuple[Claim, ...]:
    kept = []
    for limit in found.choice.limits:
        if limit.quantity.name in simulated:
            value = simulated[limit.quantity.name]
            slack = (value - limit.value) * (1.0 if limit.quantity.more_is_better else -1.0)
            held = slack >= -1e-3 * limit.value
            kept.append(Claim(limit.text, limit.value, value, limit.quantity.unit, held))
    return tuple(kept)


def _flown(found: Design, index: int, name: str, upper: bool) -> float:
    """Return what is claimed of a figure, or the end of what all readings together predict."""
    column = NAMES.index(name)
    if not upper:
        counted = float(found.judged.counted[index, column])
        return counted if math.isfinite(counted) else float(found.judged.high[index, column])
    reading = found.readings[name]
    best, error = reading.predict(found.judged.configurations[index])
    return best + error * reading.quantile(found.request.confidence)


def _table(scenario: Scenario) -> tuple[float, float]:
    """Return the thrust margin in the simulator's own table, and the scatter of thrust."""
    setup = begin(world_of(scenario), FIRST_SEED)
    margin = float(setup.maps.thrust_highest) / scenario.vehicle.hover_thrust()
    return margin, setup.effects["thrust_scatter"]["deviation"]


def _near(a: float, b: float) -> bool:
    return abs(a - b) <= _CLOSE * abs(b)


def _mean(values: Sequence[float]) -> float:
    """Return the mean of those that are known, NaN without any."""
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan


def _most(values: Sequence[float]) -> float:
    """Return the largest of those that are known, NaN without any."""
    return max((value for value in values if math.isfinite(value)), default=math.nan)


def _largest(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return max(known) if known else None
