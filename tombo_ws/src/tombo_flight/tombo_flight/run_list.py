"""The runs in a folder: what each was, when, of which version, and how it ended."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError

UNFINISHED = "unfinished"


@dataclass(frozen=True)
class Run:
    """One folder of results."""

    folder: str
    kind: str
    """flight, sweep, diagnosis, change, recovery, suite; unfinished: nothing is in it."""
    what: str
    """Scenario and seeds of flights, files of measurements."""
    when: str
    """When it was finished, ISO 8601, UTC."""
    version: str
    """Of the software, with its commit; empty: not known."""
    outcome: str
    """How it ended; empty: not known."""

    def as_mapping(self) -> dict[str, str]:
        """Return it in the types of JSON."""
        return dataclasses.asdict(self)


def list_runs(folder: Path) -> list[Run]:
    """Return the runs in a folder, the oldest first.

    Raises:
        InputError: it can't be read.
    """
    try:
        inside = [path for path in folder.iterdir() if path.is_dir()]
    except OSError as error:
        raise InputError(
            f"'{folder}': {error.strerror}; accepted: a folder of runs, as `tombo fly` makes it"
        ) from error
    found = [run_in(path) for path in inside if not path.name.startswith(".")]
    return sorted(
        (run for run in found if run is not None), key=lambda run: (run.when, run.folder)
    )


def run_in(folder: Path) -> Run | None:
    """Return the run whose results are in a folder; None: there are other things in it."""
    for name, describe in _HEADS.items():
        path = folder / name
        if path.is_file():
            try:
                values = json.loads(path.read_text(encoding="utf-8"))
                kind, what, outcome = describe(values)
                version = str(values.get("tombo_version") or values.get("version") or "")
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                kind, what, outcome, version = UNFINISHED, name, "can't be read", ""
            return Run(str(folder), kind, what, _time_of(path), version, outcome)
    if (folder / "parameters.yaml").is_file() and (folder / "logs").is_dir():
        return Run(str(folder), "suite", "", _time_of(folder), "", "")
    if not any(folder.iterdir()):
        return Run(str(folder), UNFINISHED, "", _time_of(folder), "", "")
    return None


def flight_outcome(summary: Mapping[str, Any]) -> str:
    """Return how a flight ended, in a word or two, from its summary."""
    if summary["crashed"]:
        return "crashed"
    if summary.get("interrupted"):
        return "interrupted"
    if summary["collided"]:
        return "recovered" if summary["recovery_time_s"] is not None else "not settled"
    return "landed" if summary["landed"] else "not landed"


_Described = tuple[str, str, str]
"""Kind, what, outcome."""


def _flight(values: Mapping[str, Any]) -> _Described:
    return "flight", f"{values['scenario']} seed {values['seed']}", flight_outcome(values)


def _sweep(values: Mapping[str, Any]) -> _Described:
    cases = ", ".join(case["name"] for case in values["cases"])
    axes = "".join(f" {axis['key']}" for axis in values["axes"])
    first, end = values["seeds"]
    what = f"{cases}{axes} seeds {first} to {end - 1}"
    return "sweep", what, str(values.get("outcome") or "not finished")


def _diagnosis(values: Mapping[str, Any]) -> _Described:
    measured = values.get("flights") or values.get("runs") or []
    names = [str(one["name"] if isinstance(one, Mapping) else one) for one in measured]
    return "diagnosis", ", ".join(names), str(values.get("verdict", ""))


def _recovery(values: Mapping[str, Any]) -> _Described:
    return "recovery", str(values.get("source", "")), ""


_HEADS: Mapping[str, Callable[[Mapping[str, Any]], _Described]] = {
    "summary.json": _flight,
    "sweep.json": _sweep,
    "diagnosis.json": _diagnosis,
    "recovery.json": _recovery,
}
"""The file that says what a run was, and how it says so."""


def _time_of(path: Path) -> str:
    return datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds")
