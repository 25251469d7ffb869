"""The score of many synthetic cases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tombo_benchmarks.diagnosis.stand_cases import STANDS
from tombo_dynamics.effects import REGISTRY
from tombo_flight.sweep.statistics import share_interval

Row = Mapping[str, Any]
STOCHASTIC_EFFECTS = frozenset(name for name, effect in REGISTRY.items() if effect.stochastic)
"""Effects without a mean: the number of samples limits how well they can be fitted."""
_NAMING_VERDICTS = ("named", "set")
_NAMED_OR_PARTLY = (*_NAMING_VERDICTS, "partly_explained")
_MAX_MEMBERS = 6
_BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 1.0)


def score_of_flights(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of the flights with an IMU; `mocap_only`: of those without."""
    flown = [r for r in rows if r["verdict"] != "not flown"]
    with_imu = [r for r in flown if r["formulation"].startswith("imu")]
    result = score(with_imu)
    result["mocap_only"] = score([r for r in flown if r not in with_imu])
    result["not_flown"] = len(rows) - len(flown)
    return result


def score_of_stands(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of all cases together, and of each kind of stand."""
    own = {s: score([r for r in rows if r["formulation"] == s]) for s, _ in STANDS}
    return score(rows) | own


def score(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the score of a set of cases; None where none of them counts.

    `top1_*`: the truth is first, also in a set. `answer_*` also counts a set of at most six that
    contains the truth. A set is the right answer where no measurement separates its members, and
    its order is chance then: a coefficient, the cell's gain and the air's density in thrust alone.
    """
    result: dict[str, Any] = {"cases": len(rows)}
    single = [r for r in rows if r["kind"] == "single"]
    for size in ("large", "medium", "small"):
        own = [r for r in single if r["size"] == size]
        result[f"top1_{size}"] = _share(own, _top1_correct)
        result[f"top1_{size}_cases"] = len(own)
        result[f"answer_{size}"] = _share(own, _answers)
    result["another_named"] = _share(single, _another_named)
    named = [r for r in rows if r["verdict"] == "named"]
    result["right_if_named"] = _share(named, lambda r: set(r["causes"]) <= set(r["hidden"]))
    result["named_cases"] = len(named)
    named = [r for r in single if r["verdict"] in _NAMING_VERDICTS]
    result["truth_in_set"] = _share(named, lambda r: r["hidden"][0] in _answered(r))
    result["mean_set_size"] = _of(np.mean, [len(_answered(r)) for r in named])
    healthy = [r for r in rows if r["kind"] == "none"]
    alarms = sum(r["verdict"] != "none" for r in healthy)
    result["false_alarm"] = alarms / len(healthy) if healthy else None
    result["false_alarm_upper"] = _upper(alarms, len(healthy))
    result["healthy_cases"] = len(healthy)
    unknown = [r for r in rows if r["kind"] == "unknown"]
    result["unknown_wrongly_named"] = _share(unknown, lambda r: r["verdict"] in _NAMING_VERDICTS)
    result["unknown_partly_explained"] = _share(
        unknown, lambda r: r["verdict"] == "partly_explained"
    )
    result["unknown_missed"] = _share(unknown, lambda r: r["verdict"] == "none")
    result["unknown_cases"] = len(unknown)
    pairs = [r for r in rows if r["kind"] == "pair"]
    result["pair_both"] = _share(pairs, lambda r: set(r["hidden"]) <= _answered(r))
    result["pair_one"] = _share(pairs, lambda r: bool(set(r["hidden"]) & _answered(r)))
    result["pair_cases"] = len(pairs)
    errors = [(e, v) for r in rows for e, v in r.get("parameters", {}).items()]
    for suffix, mean in (("", True), ("_chance", False)):
        own_errors = [
            v["error"]
            for e, v in errors
            if (e not in STOCHASTIC_EFFECTS) is mean and v["error"] is not None
        ]
        result[f"parameter_error{suffix}_median"] = _of(np.median, own_errors)
        result[f"parameter_error{suffix}_p90"] = _of(np.quantile, own_errors, 0.9)
    result["coverage_95"] = _of(np.mean, [c for _, v in errors for c in v["covered"]])
    result["seconds_per_case"] = _of(np.mean, [r["seconds"] for r in rows if "seconds" in r])
    result["calibration"] = _calibration(rows)
    return result


def _answered(row: Row) -> set[str]:
    return {*row["causes"], *row["set"]}


def _top1_correct(row: Row) -> bool:
    return row["verdict"] in _NAMED_OR_PARTLY and row["causes"][:1] == row["hidden"]


def _another_named(row: Row) -> bool:
    """Return whether a cause is named that is not there, and not in a set with the true one."""
    wrong = not set(row["causes"]) <= set(row["hidden"])
    return row["verdict"] in ("named", "partly_explained") and wrong


def _answers(row: Row) -> bool:
    in_set = row["hidden"][0] in row["set"] and len(row["set"]) <= _MAX_MEMBERS
    return _top1_correct(row) or (row["verdict"] in _NAMED_OR_PARTLY and in_set)


def _right(row: Row) -> bool:
    """Return whether a verdict is right."""
    if row["verdict"] == "none":
        return bool(row["kind"] == "none")
    if row["verdict"] == "unknown":
        return bool(row["kind"] == "unknown")
    if row["verdict"] == "set":
        return bool(set(row["hidden"]) & _answered(row))
    return bool(row["causes"]) and set(row["causes"]) <= set(row["hidden"])


def _calibration(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return what share of verdicts is right, by the confidence that they state."""
    table = []
    for low, high in pairwise(_BINS):
        own = [r for r in rows if low <= r["confidence"] < high or r["confidence"] == high == 1.0]
        if own:
            stated = float(np.mean([r["confidence"] for r in own]))
            right = float(np.mean([_right(r) for r in own]))
            table.append({"stated": stated, "right": right, "cases": len(own)})
    return table


def _of(statistic: Callable[..., Any], values: Sequence[float], *options: float) -> float | None:
    """Return a statistic of values; None of none."""
    return float(statistic(values, *options)) if values else None


def _share(rows: Sequence[Row], holds: Callable[[Row], bool]) -> float | None:
    return sum(holds(r) for r in rows) / len(rows) if rows else None


def _upper(count: int, of: int) -> float | None:
    """Return the upper end of the exact 95 % interval of a share (Clopper and Pearson)."""
    interval = share_interval(count, of)
    return None if interval is None else interval[1]
