"""Each trial from its files through the functions of the commands to its score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from scipy.stats import binomtest

from tombo_benchmarks.diagnosis.runner import Row
from tombo_benchmarks.real.trials import NOTHING, Trial
from tombo_diagnosis.change.diagnose import diagnose_change_unchecked
from tombo_diagnosis.crash.reason import why
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose import diagnose_unchecked
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_dynamics.errors import InputError
from tombo_logs.readers.log_reader import read_logs

OUTCOMES: Final = ("right", "set", "wrong", "unknown", "none", "refused")
"""set: at most three members, the truth among them; none: nothing is said to be wrong where
something is; refused: the logs can't be used."""
_LARGEST_SET: Final = 3
_BINS: Final = ((0.0, 0.8), (0.8, 0.9), (0.9, 1.0))
"""Of stated confidence; lower ends belong to a bin."""
_ANSWERS: Final = ("right", "set", "wrong", "none")
"""Outcomes that state something: it is right, or not."""


def answer_of(trial: Trial, folder: Path) -> tuple[str, frozenset[str], float]:
    """Diagnose as the commands do; return verdict, named causes, confidence.

    Args:
        trial: flights and question.
        folder: of all data sets.

    Raises:
        InputError: the logs can't be used.
    """
    paths = [folder / log for log in (*trial.logs, *trial.healthy)]
    flights = read_logs(paths, mapping=trial.mapping)
    new, healthy = flights[: len(trial.logs)], flights[len(trial.logs) :]
    if trial.way == "why":
        reason = why(new[0])
        if reason.cause in ("none", "unknown", "set"):
            return reason.cause, frozenset(reason.members), reason.confidence
        return "named", frozenset({reason.cause}), reason.confidence
    if trial.way == "healthy":
        found, _ = diagnose_change_unchecked(new, healthy)
        return found.verdict, _changed(found), found.confidence
    found = diagnose_unchecked(new, nominal_model())[0]
    return (
        found.verdict,
        frozenset([c.effect for c in found.causes] or found.set),
        found.confidence,
    )


def _changed(found: Diagnosis) -> frozenset[str]:
    """Return the changes as effect.rotor; a named pair as one."""
    parts = [f"{c.effect}.{c.rotor}" if c.rotor else c.effect for c in found.changed]
    if found.verdict == "named" and len(parts) > 1:
        rotors = "+".join(c.rotor for c in found.changed)
        return frozenset({f"{found.changed[0].effect}.{rotors}"})
    return frozenset(parts)


def outcome_of(trial: Trial, verdict: str, said: frozenset[str]) -> str:
    """Return which of OUTCOMES an answer is.

    Where nothing was done, anything but none is wrong, besides what is accepted.
    """
    if trial.truth == NOTHING:
        due = bool(said) and said <= trial.accepted
        return "right" if verdict == "none" or due or verdict in trial.accepted else "wrong"
    if verdict in ("none", "unknown"):
        return verdict
    if not said & trial.right or len(said) > _LARGEST_SET:
        return "wrong"
    return "right" if len(said) == 1 else "set"


def examine(trials: Sequence[Trial], folder: Path, _seed: int, number: int) -> Row:
    """Ask about one trial and score it."""
    trial = trials[number]
    row: Row = {
        "case": number, "data_set": trial.data_set, "way": trial.way, "done": trial.done,
        "truth": trial.truth, "right": sorted(trial.right),
    }  # fmt: skip
    try:
        verdict, said, confidence = answer_of(trial, folder)
    except InputError as error:
        return row | {
            "verdict": "refused", "said": [str(error)], "confidence": None, "outcome": "refused",
        }  # fmt: skip
    return row | {
        "verdict": verdict, "said": sorted(said), "confidence": confidence,
        "outcome": outcome_of(trial, verdict, said),
    }  # fmt: skip


def aggregate(rows: Sequence[Row]) -> dict[str, Any]:
    """Return outcomes of all trials, of each data set and truth, and stated against right."""
    done = [r for r in rows if r["truth"] != NOTHING]
    return {
        "cases": len(rows),
        "outcomes": _outcomes(done),
        "healthy": _outcomes([r for r in rows if r["truth"] == NOTHING]),
        "matrix": {
            data_set: {
                truth: _outcomes(
                    [r for r in rows if (r["data_set"], r["truth"]) == (data_set, truth)]
                )
                for truth in dict.fromkeys(r["truth"] for r in rows if r["data_set"] == data_set)
            }
            for data_set in dict.fromkeys(r["data_set"] for r in rows)
        },
        "stated": [_bin(rows, low, high) for low, high in (*_BINS, (0.0, 1.0))],
    }


def _outcomes(rows: Sequence[Row]) -> dict[str, int]:
    return {name: sum(r["outcome"] == name for r in rows) for name in OUTCOMES}


def _bin(rows: Sequence[Row], low: float, high: float) -> dict[str, Any]:
    """Return how often answers of a stated confidence are right, with Wilson's 95 % interval."""
    inside = [
        r
        for r in rows
        if r["outcome"] in _ANSWERS
        and r["verdict"] != "unknown"
        and low <= r["confidence"] < (high if high < 1.0 else 1.1)
    ]
    if not inside:
        return {"from": low, "to": high, "answers": 0}
    good = sum(r["outcome"] in ("right", "set") for r in inside)
    interval = binomtest(good, len(inside)).proportion_ci(method="wilson")
    return {
        "from": low, "to": high, "answers": len(inside),
        "stated": sum(r["confidence"] for r in inside) / len(inside),
        "right": good / len(inside), "low": float(interval.low), "high": float(interval.high),
    }  # fmt: skip
