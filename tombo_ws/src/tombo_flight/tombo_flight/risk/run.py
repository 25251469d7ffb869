"""Flies a study of risk into its folder, and says what came out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.json_text import plain
from tombo_flight.process.stop_signals import Stopped
from tombo_flight.process.study import Progress, Row, Task, fly_tasks, pace
from tombo_flight.process.study_folder import RESULT, Journal, open_study, write_head
from tombo_flight.report.html import write_page
from tombo_flight.report.page import Page
from tombo_flight.risk.estimate import FlightSample, RiskEstimate, estimate
from tombo_flight.risk.page import risk_page
from tombo_flight.risk.result import influence, result_of
from tombo_flight.risk.study import RiskStudy, settings_at
from tombo_flight.whole_file import whole_file

HEAD = "risk.json"
TABLE = "flights.parquet"
PAGE = "risk.html"
JOURNAL = "flights.jsonl"
_NOT_FLOWN = -1.0
"""Margin of a flight that can't be flown: it counts as a crash."""


class RiskFolder:
    """The flights of a study that are on disk."""

    def __init__(self, folder: Path, study: RiskStudy) -> None:
        self.folder, self.study = folder, study
        self.rows = Journal(folder / JOURNAL, "risk")

    @property
    def kept(self) -> int:
        """Flights that are on disk."""
        return len(self.rows)

    def remove(self) -> None:
        """Remove their file."""
        self.rows.path.unlink(missing_ok=True)


@contextmanager
def open_risk(folder: Path, study: RiskStudy, *, numbered: bool = False) -> Iterator[RiskFolder]:
    """Open the folder of a study; arguments and errors as of `open_study`."""
    values = study.as_mapping()
    with open_study(
        folder, HEAD, values, lambda own: RiskFolder(own, study), numbered=numbered
    ) as opened:
        yield opened


def fly_risk(
    folder: RiskFolder,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> Page | None:
    """Fly what is missing and write table, page and result.

    Args:
        folder: where they go.
        workers: processes; the cores that this process may use if None.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.

    Returns:
        The page, the result (docs/risk.md) as its data; None: it was stopped.

    Raises:
        InputError: no flight of the scenario can be flown.
        OSError: the folder can't be written.
    """
    study, rows = folder.study, folder.rows
    with suppress(InputError):  # a flight that can't be flown says so in its row
        warm_up_flight(study.scenario_at([]))  # once, not in each process
    tell = pace(progress, lambda: folder.kept, study.flights)

    def keep(task: Task, row: Row) -> None:
        rows[task.key] = row
        tell()

    def fly(first: int, points: Array, seeds: Array) -> Array:
        missing = [number for number in range(first, first + len(seeds)) if number not in rows]
        tasks = (
            Task(n, tuple(settings_at(study.inputs, points[n - first])), int(seeds[n - first]))
            for n in missing
        )
        fly_tasks(study, tasks, len(missing), keep, workers=workers, stop=stop)
        if not all(number in rows for number in missing):
            raise Stopped
        flown = [rows[first + i] for i in range(len(seeds))]
        return np.array([row.get("margin", _NOT_FLOWN) for row in flown])

    try:
        answer, sample = estimate(len(study.inputs), study.flights, study.method, study.seed, fly)
    except Stopped:
        return None
    return _finish(folder, answer, sample)


def _finish(folder: RiskFolder, answer: RiskEstimate, sample: FlightSample) -> Page:
    study = folder.study
    errors = [row["error"] for _, row in sorted(folder.rows.items()) if "error" in row]
    keys = [setting.key for setting in study.inputs]
    result = plain(result_of(study, answer, sample, errors, influence(keys, sample)))
    _write_table(folder.folder / TABLE, study, sample)
    page = risk_page(study, result, sample)
    write_page(folder.folder / PAGE, page)
    values = {**study.as_mapping(), RESULT: result}
    write_head(folder.folder, HEAD, values, result["outcome"])
    return page


def _write_table(path: Path, study: RiskStudy, sample: FlightSample) -> None:
    """Write one row a flight: its inputs, seed, margin and weight."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    values = [settings_at(study.inputs, point) for point in sample.points]
    columns: dict[str, Any] = {"flight": np.arange(len(values)), "seed": sample.seeds}
    for i, setting in enumerate(study.inputs):
        columns[setting.key] = np.array([float(row[i].partition("=")[2]) for row in values])
    columns |= {
        "margin": sample.margins, "crashed": sample.margins < 0.0, "weight": sample.weights,
        "drawn_as_given": sample.as_given, "search": np.arange(len(values)) < sample.first,
    }  # fmt: skip
    with whole_file(path) as unfinished:
        pq.write_table(pa.table(columns), unfinished)
