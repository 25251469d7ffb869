"""`tombo benchmark faults`: the model checker on many cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cache
from typing import Any

from tombo_benchmarks.diagnosis.runner import Row
from tombo_benchmarks.faults.fault_cases import (
    Case,
    fly_case,
    pair_cases,
    random_case,
    single_cases,
    violations,
)
from tombo_benchmarks.faults.fault_model import STEP_TICKS
from tombo_control.safety.state_machine import TABLE
from tombo_dynamics.time_base import TICK_S


@cache
def enumerated() -> list[Case]:
    """Return every single fault, and every pair, in every phase."""
    return [*single_cases(), *pair_cases()]


def examine(fixed: int, seed: int, number: int) -> Row:
    """Fly a case, and return its faults and how the flight controller behaved.

    Args:
        fixed: number of the enumerated cases, which come first; random sequences follow.
        seed: of the random sequences.
        number: of the case, from 0.

    Returns:
        `faults` and `violations`, texts; `rows`, whose bit i says that row i of the state
        machine's TABLE decided; `longest_ground_s`, the longest time with rotors on at the ground
        in a descent [s].
    """
    case = enumerated()[number] if number < fixed else random_case(seed, number - fixed)
    verdict = fly_case(case)
    return {
        "faults": [fault.text() for fault in case],
        "violations": violations(case, verdict),
        "rows": int(verdict.rows),
        "longest_ground_s": int(verdict.longest_ground) * STEP_TICKS * TICK_S,
    }


def aggregate(fixed: int, rows: Sequence[Row]) -> dict[str, Any]:
    """Return counts over all cases, and the rows of TABLE that no case used.

    `fixed` and the keys of `rows` are as of `examine`.
    """
    used = 0
    for row in rows:
        used |= row["rows"]
    unused = [
        f"{row.state.name.lower()}: {row.condition.name.lower()}"
        for i, row in enumerate(TABLE)
        if not used >> i & 1
    ]
    return {
        "enumerated": min(fixed, len(rows)),
        "random": max(len(rows) - fixed, 0),
        "violations": sum(bool(row["violations"]) for row in rows),
        "by_kind": dict(Counter(name for row in rows for name in row["violations"])),
        "longest_ground_s": max((row["longest_ground_s"] for row in rows), default=0.0),
        "rows_used": len(TABLE) - len(unused),
        "rows_unused": unused,
    }
