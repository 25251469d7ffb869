"""Flies a study of risk into its folder, and says what came out."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import flight_summary, warm_up_flight
from tombo_flight.json_text import plain
from tombo_flight.process.process_pool import process_count, stream_from_processes
from tombo_flight.process.stop_signals import Stopped
from tombo_flight.process.study_folder import RESULT, Journal, open_study, write_head
from tombo_flight.risk.estimate import Estimate, Sample, estimate
from tombo_flight.risk.influence import influence
from tombo_flight.risk.inputs import settings_at
from tombo_flight.risk.margin import margin
from tombo_flight.risk.result import result_of
from tombo_flight.risk.study import RiskStudy

HEAD = "risk.json"
TABLE = "flights.parquet"
PAGE = "risk.html"
JOURNAL = "flights.jsonl"
_NOT_FLOWN = -1.0
"""Margin of a flight that can't be flown: it counts as a crash."""
_here = threading.local()

Progress = Callable[[int, float | None], None]
"""Called with the number of flights on disk, and the time left [s] where it is known."""


class RiskFolder:
    """The flights of a study that are on disk."""

    def __init__(self, folder: Path, study: RiskStudy) -> None:
        self.folder, self.study = folder, study
        self.journal = Journal(folder / JOURNAL)

    @property
    def kept(self) -> int:
        """Flights that are on disk."""
        return len(self.journal.rows)


@contextmanager
def open_risk(folder: Path, study: RiskStudy, *, numbered: bool = False) -> Iterator[RiskFolder]:
    """Open the folder of a study; arguments and errors as of `open_study`."""
    opened: list[RiskFolder] = []

    def clear(folder: Path) -> bool:
        if any(one.kept for one in opened):
            return False
        (folder / JOURNAL).unlink(missing_ok=True)
        return True

    with open_study(folder, HEAD, study.as_mapping(), numbered=numbered, clear=clear) as own:
        opened.append(RiskFolder(own, study))
        try:
            yield opened[0]
        finally:
            opened[0].journal.close()


def fly_risk(
    folder: RiskFolder,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> dict[str, Any] | None:
    """Fly what is missing and write table, page and result.

    Args:
        folder: where they go.
        workers: processes; the cores that this process may use if None.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.
        page: write the page, for which the most likely crash is flown again.

    Returns:
        The result (docs/risk.md); None: it was stopped.

    Raises:
        InputError: no flight of the scenario can be flown.
        OSError: the folder can't be written.
    """
    study, began, before = folder.study, time.monotonic(), folder.kept
    with suppress(InputError):  # a flight that can't be flown says so in its row
        warm_up_flight(study.scenario_at([]))  # once, not in each process

    def tell() -> None:
        rate = (folder.kept - before) / max(time.monotonic() - began, 1e-6)
        if progress is not None:
            progress(folder.kept, (study.flights - folder.kept) / rate if rate > 0.0 else None)

    def fly(first: int, points: Array, seeds: Array) -> Array:
        rows = folder.journal.rows
        missing = (
            (first + i, settings_at(study.inputs, point), int(seed))
            for i, (point, seed) in enumerate(zip(points, seeds, strict=True))
            if first + i not in rows
        )
        count = process_count(workers)
        found = stream_from_processes(
            _fly, missing, count, begin=_begin, given=(study,), stop=stop, copies=True
        )
        with closing(found):
            for row in found:
                folder.journal.append(row)
                tell()
        if not all(first + i in rows for i in range(len(seeds))):
            raise Stopped
        return np.array([rows[first + i]["margin"] for i in range(len(seeds))])

    try:
        answer, sample = estimate(len(study.inputs), study.flights, study.method, study.seed, fly)
    except Stopped:
        return None
    return _finish(folder, answer, sample, page)


def _finish(folder: RiskFolder, answer: Estimate, sample: Sample, page: bool) -> dict[str, Any]:
    study = folder.study
    errors = [row["error"] for _, row in sorted(folder.journal.rows.items()) if "error" in row]
    keys = [one.key for one in study.inputs]
    result = plain(result_of(study, answer, sample, errors, influence(keys, sample)))
    _write_table(folder.folder / TABLE, study, sample)
    if page:
        from tombo_flight.risk.page import write_page

        write_page(folder.folder / PAGE, study, result, sample)
    values = {**study.as_mapping(), RESULT: result}
    write_head(folder.folder, HEAD, values, result["outcome"])
    return dict(result)


def _write_table(path: Path, study: RiskStudy, sample: Sample) -> None:
    """Write one row a flight: its inputs, seed, margin and weight."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    values = [settings_at(study.inputs, point) for point in sample.points]
    columns: dict[str, Any] = {"flight": np.arange(len(values)), "seed": sample.seeds}
    for i, one in enumerate(study.inputs):
        columns[one.key] = np.array([float(row[i].partition("=")[2]) for row in values])
    columns |= {
        "margin": sample.margins, "crashed": sample.margins < 0.0, "weight": sample.weights,
        "drawn_as_given": sample.as_given, "search": np.arange(len(values)) < sample.first,
    }  # fmt: skip
    unfinished = path.with_name(f".{path.name}.unfinished")
    pq.write_table(pa.table(columns), unfinished)
    os.replace(unfinished, path)


def _begin(study: RiskStudy) -> None:
    """Prepare a process: it keeps study and memory."""
    _here.study, _here.workspace = study, Workspace()


def _fly(task: tuple[int, Sequence[str], int]) -> dict[str, Any]:
    """Return the row of a flight."""
    flight, settings, seed = task
    try:
        scenario = _here.study.scenario_at(settings)
        summary = flight_summary(fly_scenario(scenario, seed, _here.workspace))
    except InputError as error:
        return {"flight": flight, "margin": _NOT_FLOWN, "error": str(error)}
    return {"flight": flight, "margin": margin(summary, scenario)}
