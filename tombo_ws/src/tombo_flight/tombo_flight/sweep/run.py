"""The folder of a sweep: what is flown is on disk at once, and joined into one table at the end.

Flights are kept in blocks. A block that is not whole is a file of JSON lines, one a flight,
written as they come; a whole one is sorted into a Parquet file. So memory holds a block or two, a
process that is killed loses no flight that was over, and the table does not depend on the order.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tombo_dynamics.errors import InputError
from tombo_flight.flight_output import warm_up_flight
from tombo_flight.process.study import Progress, Row, Task, fly_tasks, pace
from tombo_flight.process.study_folder import Journal, open_study, write_head
from tombo_flight.report.html import write_page
from tombo_flight.report.page import Page
from tombo_flight.sweep.page import sweep_page
from tombo_flight.sweep.study import SweepStudy, schema_of, table_of
from tombo_flight.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa


STUDY_FILE = "sweep.json"
TABLE = "flights.parquet"
PAGE = "sweep.html"
PARTS = "parts"
BLOCK = 10_000
"""Flights of a part."""


class SweepFolder:
    """The flights of a study in a folder; see `open_store`."""

    def __init__(self, folder: Path, sweep: SweepStudy) -> None:
        self.folder = folder
        self.sweep = sweep
        self._parts = folder / PARTS
        self._open: dict[int, Journal] = {}
        self.kept = 0
        """Flights that are on disk."""
        if self.finished:
            self.kept = sweep.flights
            return
        self._parts.mkdir(exist_ok=True)
        for number in range(self.blocks):
            if self._whole(number).is_file():
                self._journal(number).unlink(missing_ok=True)
                self.kept += len(self._flights_of(number))
            elif self._journal(number).is_file():
                self.kept += len(self._block(number))

    @property
    def finished(self) -> bool:
        """Whether the table is there."""
        return (self.folder / TABLE).is_file()

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.sweep.flights // BLOCK)

    def missing(self) -> Iterator[int]:
        """Yield the flights that are not on disk, in their order."""
        for number in range(self.blocks):
            if not self._whole(number).is_file():
                there = set(self._block(number))
                yield from (flight for flight in self._flights_of(number) if flight not in there)

    def keep(self, row: Mapping[str, Any]) -> None:
        """Put a flight on disk.

        Raises:
            OSError: it can't be written.
        """
        number = row["flight"] // BLOCK
        block = self._block(number)
        block[row["flight"]] = dict(row)
        self.kept += 1
        if len(block) == len(self._flights_of(number)):
            self._seal(number)

    def finish(self) -> None:
        """Join the parts into the table, in the order of the flights.

        Raises:
            OSError: it can't be written.
        """
        import pyarrow.parquet as pq

        with (
            whole_file(self.folder / TABLE) as unfinished,
            pq.ParquetWriter(unfinished, self._schema()) as writer,
        ):
            for number in range(self.blocks):
                writer.write_table(pq.read_table(self._whole(number)))
        shutil.rmtree(self._parts)

    def _seal(self, number: int) -> None:
        """Put a whole block into its part, which takes the place of its lines."""
        import pyarrow.parquet as pq

        block = self._open.pop(number)
        rows = [block[flight] for flight in sorted(block)]
        with whole_file(self._whole(number)) as unfinished:
            pq.write_table(table_of(rows, self.sweep.design, self._schema()), unfinished)
        self._journal(number).unlink()

    def _schema(self) -> pa.Schema:
        return schema_of(self.sweep.design, self.sweep.as_mapping())

    def _block(self, number: int) -> Journal:
        if number not in self._open:
            self._open[number] = Journal(self._journal(number), "sweep")
        return self._open[number]

    def _flights_of(self, number: int) -> range:
        return range(number * BLOCK, min((number + 1) * BLOCK, self.sweep.flights))

    def _whole(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _journal(self, number: int) -> Path:
        return self._parts / f"{number:06d}.jsonl"

    def remove(self) -> None:
        """Remove the parts."""
        shutil.rmtree(self._parts, ignore_errors=True)


@contextmanager
def open_store(
    folder: Path, sweep: SweepStudy, *, numbered: bool = False
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep: a new or empty one, or that of the same sweep, to go on with.

    A new one is gone again where not one flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        sweep: what is flown.
        numbered: make a new folder, with a number behind its name where that is taken.

    Raises:
        InputError: something else is in it, or another process flies it.
        OSError: it can't be written.
    """
    values = sweep.as_mapping()
    with open_study(
        folder, STUDY_FILE, values, lambda own: SweepFolder(own, sweep), numbered=numbered
    ) as store:
        yield store


def fly_sweep(
    store: SweepFolder,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> Page | None:
    """Fly the flights that the store does not have, and write table and page.

    Args:
        store: where they go.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.
        page: write the page.

    Returns:
        The page, with the outcome in a line among its data; None: it was stopped.

    Raises:
        InputError: the scheduler can't be reached, or has another version of the suite.
        OSError: the folder can't be written.
    """
    sweep = store.sweep
    if not store.finished:
        if scheduler is None:
            with suppress(InputError):  # a flight that can't be flown says so in its row
                warm_up_flight(sweep.scenario_at(0))  # once, not in each process
        tell = pace(progress, lambda: store.kept, sweep.flights)

        def keep(task: Task, row: Row) -> None:
            place = {"flight": task.key, "point": task.point, "seed": task.seed}
            store.keep({**place, **sweep.points[task.point], **row})
            tell()

        tasks = (Task(flight, *sweep.place(flight)) for flight in store.missing())
        missing = sweep.flights - store.kept
        fly_tasks(sweep, tasks, missing, keep, workers=workers, scheduler=scheduler, stop=stop)
        if store.kept < sweep.flights:
            return None
        store.finish()
    result = sweep_page(store.folder / TABLE, sweep)
    if page:
        write_page(store.folder / PAGE, result)
        write_head(store.folder, STUDY_FILE, sweep.as_mapping(), result.data["outcome"])
    return result
