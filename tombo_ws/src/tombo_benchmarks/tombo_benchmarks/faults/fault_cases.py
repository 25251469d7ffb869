"""Cases for the model checker: single faults and pairs in every phase, and random sequences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import numpy as np

from tombo_benchmarks.faults.fault_model import (
    STEP_TICKS,
    Fault,
    Verdict,
    fly_faults,
    new_suite,
    new_world,
)

_STEPS_PER_S = 1000 // STEP_TICKS
HORIZON_S = 80.0
"""A case is watched for so long, or until nothing turns and nothing is to come."""
_FOR_EVER = 10**6
_RESTART_S = 0.4
"""No process is restarted faster: the flight controller's fail-safe has taken over by then."""
PHASES_S = {
    "idle": 0.5,
    "takeoff": 1.7,
    "hover": 4.0,
    "approach": 6.5,
    "react": 8.5,
    "land": 15.0,
    "touchdown": 18.1,
    "landed": 20.0,
}
"""Phase of the model's flight → a time in it [s]; in `react` a collision comes before."""
_COLLISION_S = 7.5
DURATIONS_S = (0.05, 0.4, 2.0, 8.0, None)
"""How long a fault lasts; None: for ever."""
GROUND_LIMIT_S, GROUND_LIMIT_NUMB_S = 4.0, 20.0
"""Rotors may turn on the ground in a descent for so long; without accelerometer it is the time
limit of the descent that ends it."""


@dataclass(frozen=True)
class FaultAt:
    """A fault and when it is there."""

    fault: Fault
    begin_s: float
    lasts_s: float | None

    def row(self) -> tuple[int, int, int]:
        """Return it as the model takes it."""
        begin = round(self.begin_s * _STEPS_PER_S)
        least = _RESTART_S if self.fault == Fault.CONTROLLER else 0.0
        lasts_s = _FOR_EVER if self.lasts_s is None else max(self.lasts_s, least)
        steps = min(max(round(lasts_s * _STEPS_PER_S), 1), _FOR_EVER)
        return int(self.fault), begin, begin + steps

    def text(self) -> str:
        """Return it in words."""
        how_long = "for ever" if self.lasts_s is None else f"for {self.lasts_s:g} s"
        return f"{self.fault.name.lower()} at {self.begin_s:g} s {how_long}"


Case = tuple[FaultAt, ...]


def _in_phase(phase: str, *faults: FaultAt) -> Case:
    collision = (FaultAt(Fault.COLLISION, _COLLISION_S, 0.05),) if phase == "react" else ()
    return collision + faults


def single_cases() -> Iterator[Case]:
    """Return every fault in every phase, of every duration."""
    for fault, (phase, begin_s), lasts_s in product(Fault, PHASES_S.items(), DURATIONS_S):
        yield _in_phase(phase, FaultAt(fault, begin_s, lasts_s))


def pair_cases(seed: int = 0) -> Iterator[Case]:
    """Return every pair of faults in every phase; distance in time and durations by chance."""
    rng = np.random.default_rng(seed)
    pairs = combinations_with_replacement(Fault, 2)
    for (first, second), (phase, begin_s) in product(pairs, PHASES_S.items()):
        later_s = round(begin_s + float(rng.choice([0.0, 0.1, 0.5, 1.5, 4.0])), 3)
        one, other = (DURATIONS_S[int(i)] for i in rng.integers(0, len(DURATIONS_S), 2))
        yield _in_phase(phase, FaultAt(first, begin_s, one), FaultAt(second, later_s, other))


def random_case(seed: int, index: int) -> Case:
    """Return one to five faults at any time of the flight and after it."""
    rng = np.random.default_rng([seed, index])
    faults = []
    for _ in range(int(rng.integers(1, 6))):
        lasts_s = DURATIONS_S[int(rng.integers(0, len(DURATIONS_S)))]
        begin_s = round(float(rng.uniform(0.0, 25.0)), 3)
        faults.append(FaultAt(Fault(int(rng.integers(0, len(Fault)))), begin_s, lasts_s))
    return tuple(faults)


def fly_case(case: Case) -> Verdict:
    """Fly a case; return what happened."""
    verdict = Verdict.new()
    rows = np.array([one.row() for one in case], dtype=np.int64).reshape(-1, 3)
    fly_faults(new_suite(), new_world(), rows, round(HORIZON_S * _STEPS_PER_S), verdict)
    return verdict


def violations(case: Case, verdict: Verdict) -> list[str]:
    """Return what happened that must not, in words; empty: nothing."""
    found = []
    if verdict.thrust_after_touchdown:
        found.append("thrust after touchdown")
    if verdict.uncommanded:
        found.append("take-off without a command")
    if verdict.far_setpoints:
        found.append("set point further than the vehicle can follow")
    if verdict.outside:
        found.append("set point outside of the flight volume")
    if verdict.fast_falls:
        found.append("hit the ground at more than 2 m/s")
    numb = any(one.fault == Fault.ACCELEROMETER for one in case)
    limit_s = GROUND_LIMIT_NUMB_S if numb else GROUND_LIMIT_S
    if verdict.longest_ground / _STEPS_PER_S > limit_s:
        found.append("rotors on at the ground in a descent")
    if verdict.still_on:
        found.append("rotors on at the end")
    return found
