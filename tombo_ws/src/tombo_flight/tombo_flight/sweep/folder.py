"""The folder of a sweep: a sweep continues after a kill with the flights that are missing.

Each batch of flights is a Parquet file in `parts/` as soon as it is flown; at the end all are
joined to `flights.parquet`. The table does not depend on the number of interruptions.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_flight.json_text import as_json
from tombo_flight.process.output_folder import (
    RESULT_FILES,
    make_folder,
    remove_empty,
    whole_file,
    write_whole,
)
from tombo_flight.process.study import FlownTasks, Task, fly_tasks
from tombo_flight.sweep.study import SweepStudy

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from tombo_flight.report.page import Page

HEAD = "sweep.json"
PAGE = "sweep.html"
TABLE = "flights.parquet"
PARTS = "parts"
KEY = "flight"
"""Column of the number of a flight."""
OUTCOME = "outcome"
"""Key of the head that does not belong to the study, like `RESULT`."""
RESULT = "result"
Progress = Callable[[int, float], None]
"""Called with the number of flights that are on disk, and the time left [s]."""


class SweepFolder:
    """The flights of a sweep that are on disk; see `open_sweep`."""

    def __init__(self, folder: Path, study: SweepStudy) -> None:
        """Read which flights are there.

        Raises:
            InputError: a file has no flights of this sweep.
        """
        self.folder = folder
        self.study = study
        self.is_kept = np.zeros(study.flights, dtype=bool)
        """Whether each flight is on disk."""
        for path in self._files():
            flights = self._read(path).column(KEY).to_numpy()
            if self.is_kept[flights].all():  # killed after the table was written
                path.unlink()
            self.is_kept[flights] = True

    @property
    def kept(self) -> int:
        """Number of flights that are on disk."""
        return int(self.is_kept.sum())

    def missing(self) -> Iterator[Task]:
        """Yield the flights that are not on disk."""
        for flight in np.flatnonzero(~self.is_kept).tolist():
            yield Task(flight, *self.study.place(flight))

    def keep(self, flown: FlownTasks) -> None:
        """Put a batch of flights on disk, in a file that is named by the first.

        Raises:
            OSError: it can't be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        rows = [
            {KEY: task.key, "seed": task.seed, **self.study.labels(task.point), **row}
            for task, row in flown
        ]
        parts = self.folder / PARTS
        parts.mkdir(exist_ok=True)
        with whole_file(parts / f"{rows[0][KEY]:09d}.parquet") as unfinished:
            pq.write_table(pa.Table.from_pylist(rows, self._schema()), unfinished)
        self.is_kept[[row[KEY] for row in rows]] = True

    def finish(self) -> None:
        """Join all flights into one table, in their order.

        Raises:
            InputError: a part can't be read.
            OSError: the table can't be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        table, files = self.folder / TABLE, self._files()
        if files != [table]:
            joined = pa.concat_tables([self._read(path) for path in files]).sort_by(KEY)
            with whole_file(table) as unfinished:
                pq.write_table(joined, unfinished)
            shutil.rmtree(self.folder / PARTS)

    def table(self) -> pd.DataFrame:
        """Return all flights, at the end."""
        read: pd.DataFrame = self._read(self.folder / TABLE).to_pandas()
        return read

    def write_head(self, result: Mapping[str, Any] | None = None) -> None:
        """Write the study, and at the end its result."""
        more = {} if result is None else {RESULT: result}
        outcome = "" if result is None else result[OUTCOME]
        values = {**self.study.as_mapping(), **more, OUTCOME: outcome}
        write_whole(self.folder / HEAD, as_json(values))

    def _files(self) -> list[Path]:
        parts = sorted((self.folder / PARTS).glob("[0-9]*.parquet"))
        table = self.folder / TABLE
        return [*([table] if table.is_file() else []), *parts]

    def _read(self, path: Path) -> pa.Table:
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            return pq.read_table(path).select(list(self.study.columns())).cast(self._schema())
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise InputError(
                f"'{path}' has no flights of this sweep: {error}; accepted: another folder, or "
                "without this file: its flights are flown again"
            ) from None

    def _schema(self) -> pa.Schema:
        """Return the schema of the rows, with the whole study in its metadata."""
        import pyarrow as pa

        kinds = {
            "text": pa.string(), "yes or no": pa.bool_(), "count": pa.int64(),
            "number": pa.float64(),
        }  # fmt: skip
        fields = [(name, kinds[kind]) for name, kind in self.study.columns().items()]
        text = json.dumps(self.study.as_mapping(), ensure_ascii=False)
        return pa.schema(fields, metadata={"tombo": text})


@contextmanager
def open_sweep(
    folder: Path, study: SweepStudy, *, numbered: bool = False, again: bool = False
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep: a new or empty one, or that of the same sweep, to go on with.

    A new one, with the parents made for it, is removed if no flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        study: the sweep.
        numbered: make a new folder, with a number behind its name where that is taken.
        again: remove the results that are in the folder, of whatever was flown.

    Raises:
        InputError: something else is in it, another process flies it, or it can't be written.
    """
    try:
        folder, made = make_folder(folder, numbered=numbered)
    except OSError as error:
        raise InputError(
            f"-o {folder}: can't be written ({error.strerror}); accepted: a folder, new or empty"
        ) from error
    with folder_lock(folder):
        if again:
            for name in (*RESULT_FILES, HEAD, PAGE, TABLE):
                (folder / name).unlink(missing_ok=True)
            shutil.rmtree(folder / PARTS, ignore_errors=True)
        begun = not again and _is_begun(folder, study)
        opened = SweepFolder(folder, study)
        try:
            if not begun:
                opened.write_head()
            yield opened
        finally:
            if not opened.kept:
                (folder / HEAD).unlink(missing_ok=True)
                if made:
                    shutil.rmtree(folder)
                    remove_empty(made)


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Refuse a folder in which another process flies.

    Raises:
        InputError: one does.
    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise InputError(
            f"-o {folder}: another process flies this sweep; accepted: another folder"
        ) from None
    finally:
        os.close(lock)


def _is_begun(folder: Path, study: SweepStudy) -> bool:
    """Return whether the sweep was begun in a folder.

    Raises:
        InputError: another one was, or there are other things.
    """
    if not (folder / HEAD).is_file():
        names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if names:
            raise InputError(
                f"-o {folder}: it is not empty ({', '.join(names[:3])}); accepted: a new or empty "
                "folder, or that of the same sweep, which then goes on"
            )
        return False
    there, here = read_head(folder), study.as_mapping()
    differing = sorted(
        key for key in {*there, *here} - {OUTCOME, RESULT} if there.get(key) != here.get(key)
    )
    if differing:
        raise InputError(
            f"-o {folder}: a sweep with another {', another '.join(differing)} was begun in it; "
            "accepted: the same sweep, which then goes on, or another folder"
        )
    return True


def read_head(folder: Path) -> dict[str, Any]:
    """Return the content of a sweep's file.

    Raises:
        InputError: it can't be read.
    """
    path = folder / HEAD
    try:
        values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"'{path}': {error}; accepted: a folder of a sweep") from None
    return values


def fly_sweep(
    opened: SweepFolder,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> Page | None:
    """Fly the missing flights of a sweep's folder, and write table, page and result.

    Args:
        opened: the folder.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: receives the progress.
        stop: asked now and then; True ends it, with the finished flights on disk.
        page: make page and result, too.

    Returns:
        The page; None: it was stopped, or there is none.

    Raises:
        InputError: the scheduler can't be reached.
        OSError: the folder can't be written.
    """
    study, began, before = opened.study, time.monotonic(), opened.kept

    def keep(flown: FlownTasks) -> None:
        opened.keep(flown)
        if progress is not None:
            rate = (opened.kept - before) / max(time.monotonic() - began, 1e-6)
            progress(opened.kept, (study.flights - opened.kept) / rate)

    tasks, missing = opened.missing(), study.flights - before
    fly_tasks(study, tasks, missing, keep, workers=workers, scheduler=scheduler, stop=stop)
    if opened.kept < study.flights:
        return None
    opened.finish()
    if not page:
        return None
    from tombo_flight.report.page import write_page
    from tombo_flight.sweep.page import sweep_page

    made = sweep_page(opened)
    write_page(opened.folder / PAGE, made)
    opened.write_head(made.data)
    return made
