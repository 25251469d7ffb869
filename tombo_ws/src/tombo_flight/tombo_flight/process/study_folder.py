"""The folder of a study of many flights: one process flies in it, and it goes on after a kill.

Each flight is a row: a line of `flights.jsonl` as soon as it is over, whole parts of these in
Parquet files, all of them in `flights.parquet` at the end. So memory holds one part, and what is
flown does not depend on how often the study was stopped.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
import shutil
import time
from collections import UserDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_flight.json_text import as_json
from tombo_flight.process.output_folder import make_numbered, whole_file, write_whole
from tombo_flight.process.stop_signals import Stopped
from tombo_flight.process.study import FlightRow, Study, Task, fly_tasks

if TYPE_CHECKING:
    import pyarrow as pa

    from tombo_flight.report.page import Page

Progress = Callable[[int, float], None]
"""Called with the number of flights kept, and the time left [s]."""
Fly = Callable[[Iterable[Task], int], None]
"""Flies tasks, so many at most, that are not kept yet."""
OUTCOME = "outcome"
"""Key of the study's file that is no part of the study, as is `RESULT`."""
RESULT = "result"
TABLE = "flights.parquet"
JOURNAL = "flights.jsonl"
PARTS = "parts"
PART_FLIGHTS = 10_000
KEY = "flight"
"""Column of the key of a flight."""
_UNITS = {"rad": "rad", "m": "m", "s": "s", "n": "N"}
"""Ending of a figure's name → unit."""


class Journal(UserDict[Any, FlightRow]):
    """Rows by number or name, one a line of a file; a line cut by a kill is left out."""

    def __init__(self, path: Path, run: str) -> None:
        """Read what is there.

        Args:
            path: the file, made with the first row.
            run: what the rows are of.

        Raises:
            InputError: it is of another run, or can't be read.
        """
        super().__init__()
        self.path = path
        self._run = run
        try:
            lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"'{path}' can't be read: {error}") from error
        for line in lines:
            try:
                kept_run, key, row = json.loads(line)
            except (ValueError, TypeError):
                continue
            if kept_run != run or not isinstance(key, int | str) or not isinstance(row, dict):
                raise InputError(
                    f"'{path}' is of {shown(kept_run)}, this is {shown(run)}; accepted: the same "
                    "command and seed, or another -o"
                )
            self.data[key] = row

    def __setitem__(self, key: Any, row: FlightRow) -> None:
        """Append a row; errors as of `append`."""
        self.append([(key, row)])

    def append(self, rows: Sequence[tuple[Any, FlightRow]]) -> None:
        """Append rows with their keys.

        Raises:
            OSError: they can't be written.
        """
        lines = [json.dumps([self._run, key, row], default=_number) for key, row in rows]
        try:
            with self.path.open("a", encoding="utf-8") as file:
                # a line that a kill has cut ends here
                file.write("".join(f"\n{line}" for line in lines))
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        self.data.update(rows)


def _number(value: Any) -> Any:
    """Return a number or list of numpy as Python's own."""
    return value.tolist()


class StudyFolder:
    """The flights of a study that are on disk; see `open_study`."""

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study
        self.keys: set[Any] = set()
        """Of the flights that are on disk."""
        self._first: dict[Path, Any] = {}
        """Files of whole parts, with the smallest key of each."""
        self._parts = folder / PARTS
        for path in (self.table, *sorted(self._parts.glob("[0-9]*.parquet"))):
            if path.is_file():
                self._take(path)
        self._journal = Journal(folder / JOURNAL, study.kind)
        for key in self.keys & self._journal.keys():  # killed before the file was removed
            del self._journal.data[key]
        self.keys |= self._journal.keys()
        self._others = sum(key not in study.keys for key in self.keys)

    @property
    def table(self) -> Path:
        """The file with all flights, at the end."""
        return self.folder / TABLE

    @property
    def kept(self) -> int:
        """Number of the study's flights that are on disk."""
        return len(self.keys) - self._others

    def keep(self, flown: Sequence[tuple[Task, FlightRow]]) -> None:
        """Put flights on disk.

        Raises:
            OSError: they can't be written.
        """
        rows = [
            (task.key, {"seed": task.seed, **self.study.labels(task.point), **row})
            for task, row in flown
        ]
        self._journal.append(rows)
        self.keys.update(key for key, _ in rows)
        if len(self._journal) >= PART_FLIGHTS:
            self._seal()

    def finish(self) -> None:
        """Join all flights into one table, in the order of their keys.

        Raises:
            InputError: a part can't be read.
            OSError: the table can't be written.
        """
        if self._journal:
            self._seal()
        paths = sorted(self._first, key=self._first.__getitem__)
        if len(paths) == 1:  # it is the table
            paths[0].replace(self.table)
        else:
            self._join(paths)
        with suppress(OSError):
            self._parts.rmdir()
        self._first = {self.table: self._first[paths[0]]}

    def _join(self, paths: Sequence[Path]) -> None:
        """Write the table out of parts, which are in the order of their smallest keys."""
        import pyarrow as pa
        import pyarrow.compute as pc
        import pyarrow.parquet as pq

        schema = self._schema()
        waiting = schema.empty_table()
        with whole_file(self.table) as unfinished, pq.ParquetWriter(unfinished, schema) as writer:
            for path, following in zip(paths, [*paths[1:], None], strict=True):
                waiting = pa.concat_tables([waiting, self._read(path)]).sort_by(KEY)
                ready = waiting
                if following is not None:
                    before = pc.less(waiting.column(KEY), self._first[following])
                    ready, waiting = waiting.filter(before), waiting.filter(pc.invert(before))
                writer.write_table(ready)
        for path in paths:
            if path != self.table:
                path.unlink()

    def rows(self, names: Sequence[str]) -> dict[Any, FlightRow]:
        """Return columns of all rows by key, in its order; None: a flight has no such figure.

        Raises:
            InputError: a file can't be read.
        """
        rows = {key: {name: row.get(name) for name in names} for key, row in self._journal.items()}
        for path in self._first:
            for row in self._read(path, [KEY, *names]).to_pylist():
                rows[row.pop(KEY)] = row
        return dict(sorted(rows.items()))

    def numbers(self, name: str) -> tuple[NDArray[np.int64], Array]:
        """Return the numbers of all flights and one of their figures, in order; NaN: none.

        Raises:
            InputError: a file can't be read.
        """
        keys = [np.array([*self._journal], dtype=np.int64)]
        rows = (row.get(name) for row in self._journal.values())
        values = [np.array([math.nan if value is None else value for value in rows], dtype=float)]
        for path in self._first:
            read = self._read(path, [KEY, name])
            keys.append(read.column(KEY).to_numpy())
            values.append(read.column(name).to_numpy())
        flights = np.concatenate(keys)
        order = np.argsort(flights, kind="stable")
        return flights[order], np.concatenate(values)[order]

    def add_columns(self, columns: Mapping[str, Any]) -> None:
        """Add columns to the table, each with a value for each key in its order."""
        import pyarrow.parquet as pq

        table = self._read(self.table)
        for name, values in columns.items():
            table = table.append_column(name, [values])
        with whole_file(self.table) as unfinished:
            pq.write_table(table, unfinished)

    def write_head(self, result: Mapping[str, Any] | None = None) -> None:
        """Write the study and what came out, of a study without values that alone."""
        values = self.study.as_mapping()
        if values:
            more = {} if result is None else {RESULT: result}
            result = {**values, **more, OUTCOME: (result or {}).get(OUTCOME, "")}
        write_whole(self.folder / f"{self.study.kind}.json", as_json(result))

    def _take(self, path: Path) -> None:
        """Count the flights of a part; one that the table has already is removed."""
        keys = self._read(path, [KEY]).column(KEY).to_pylist()
        if self.keys.issuperset(keys):
            path.unlink()
            return
        self.keys.update(keys)
        self._first[path] = min(keys)

    def _seal(self) -> None:
        """Put the flights of the journal into a part, which takes its place."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        known = {path.name for path in self._first}
        number = next(n for n in range(len(known) + 1) if f"{n:06d}.parquet" not in known)
        path = self._parts / f"{number:06d}.parquet"
        self._parts.mkdir(exist_ok=True)
        rows = sorted(self._journal.items())
        schema = self._schema()
        columns = [
            [key for key, _ in rows]
            if column.name == KEY
            else [row.get(column.name) for _, row in rows]
            for column in schema
        ]
        arrays = [_column(c, field.type) for c, field in zip(columns, schema, strict=True)]
        with whole_file(path) as unfinished:
            pq.write_table(pa.table(arrays, schema=schema), unfinished)
        self._first[path] = rows[0][0]
        self._journal.path.unlink()
        self._journal.data.clear()

    def _read(self, path: Path, columns: Sequence[str] | None = None) -> pa.Table:
        import pyarrow as pa
        import pyarrow.parquet as pq

        schema = self._schema()
        try:
            with pq.ParquetFile(path) as file:  # `read_table` loads much more of pyarrow
                read = file.read(list(columns or schema.names))
            return read if columns else read.select(schema.names).cast(schema)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise InputError(
                f"'{path}' has no flights of this {self.study.kind}: {error}; accepted: another "
                "folder, or without this file: its flights are flown again"
            ) from None

    def _schema(self) -> pa.Schema:
        """Return the schema of the rows, with units, and the whole study in its metadata."""
        import pyarrow as pa

        kinds = {
            "text": pa.string(), "yes or no": pa.bool_(), "count": pa.int64(),
            "number": pa.float64(),
        }  # fmt: skip
        fields = []
        for name, kind in self.study.columns().items():
            unit = {"unit": unit_of(name)} if unit_of(name) else None
            fields.append(pa.field(name, kinds[kind], metadata=unit))
        text = json.dumps(self.study.as_mapping(), ensure_ascii=False)
        return pa.schema(fields, metadata={"tombo": text})


def _column(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Return a column of texts, truths, whole numbers or numbers, in which None is no value.

    `pa.array` would import pandas first, which takes a fifth of a second.
    """
    import pyarrow as pa

    there = [value is not None for value in values]
    valid = None if all(there) else pa.py_buffer(_bits(there))
    if kind == pa.string():
        texts = [b"" if value is None else value.encode() for value in values]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        data = [pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
    elif kind == pa.bool_():
        data = [pa.py_buffer(_bits([bool(value) for value in values]))]
    else:
        numbers = [0 if value is None else value for value in values]
        data = [pa.py_buffer(np.array(numbers, kind.to_pandas_dtype()))]
    return pa.Array.from_buffers(kind, len(values), [valid, *data])


def _bits(truths: Sequence[bool]) -> bytes:
    return np.packbits(truths, bitorder="little").tobytes()


def remove_flights(folder: Path) -> None:
    """Remove the flights that are in the folder of a study."""
    shutil.rmtree(folder / PARTS, ignore_errors=True)
    for name in (TABLE, JOURNAL):
        (folder / name).unlink(missing_ok=True)


def unit_of(name: str) -> str:
    """Return the unit that the name of a figure ends with; empty: it has none."""
    return _UNITS.get(name.rpartition("_")[2], "")


@contextmanager
def open_study(
    folder: Path, study: Study, *, numbered: bool = False, again: bool | None = None
) -> Iterator[StudyFolder]:
    """Open the folder of a study: a new or empty one, or that of the same study, to go on with.

    A new one is gone again where not one flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        study: what is flown; one without values may be of other flights each time.
        numbered: make a new folder, with a number behind its name where that is taken.
        again: remove the flights that are in the folder, of whatever study, as --force asks for;
            None: there is no such option.

    Raises:
        InputError: something else is in it, or another process flies it.
        OSError: it can't be written.
    """
    new = numbered or not folder.exists()
    try:
        if numbered:
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder = make_numbered(folder)
        else:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"-o {folder}: can't be written ({error.strerror}); accepted: a folder, new or empty"
        ) from error
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"-o {folder}: another process flies this {study.kind}; accepted: another folder"
            ) from None
        head = folder / f"{study.kind}.json"
        begun = _is_begun(folder, head, study, again=again)
        opened = None
        try:
            if again:
                remove_flights(folder)
            opened = StudyFolder(folder, study)
            if study.as_mapping() and (again or not begun):
                opened.write_head()
            yield opened
        finally:
            if not begun and opened is not None and not opened.kept:
                head.unlink(missing_ok=True)
                remove_flights(folder)
                if new:
                    with suppress(OSError):
                        folder.rmdir()
    finally:
        os.close(lock)


def read_head(folder: Path, kind: str) -> dict[str, Any]:
    """Return what the file of a study says.

    Raises:
        InputError: there is none.
    """
    path = folder / f"{kind}.json"
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"'{path}': {error}; accepted: a folder of a {kind}") from None
    if not isinstance(values, dict):
        raise InputError(f"'{path}': no {kind}; accepted: a folder of a {kind}")
    return values


def _is_begun(folder: Path, head: Path, study: Study, *, again: bool | None) -> bool:
    """Return whether the study was begun in a folder.

    Raises:
        InputError: another study was, or there are other things.
    """
    kind, values = study.kind, study.as_mapping()
    flights = (folder / JOURNAL).is_file() or (folder / TABLE).is_file()
    if not head.is_file() and not (flights and not values):
        names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if names and not again:
            raise InputError(
                f"-o {folder}: it is not empty ({', '.join(names[:3])}); accepted: a new or empty "
                f"folder, or one of the same {kind}, which then goes on"
                + (", or --force" if again is False else "")
            )
        return False
    if values and not again:
        there = read_head(folder, kind)
        keys = {*there, *values} - {OUTCOME, RESULT}
        other = sorted(key for key in keys if there.get(key) != values.get(key))
        if other:
            raise InputError(
                f"-o {folder}: a {kind} with another {', another '.join(other)} was begun in it; "
                f"accepted: the same {kind}, which then goes on, or another folder"
            )
    return True


def fly_study(
    opened: StudyFolder,
    analyse: Callable[[StudyFolder, Fly], Page],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    page: bool = True,
) -> Page | None:
    """Fly what a study's folder does not have, and write table, page and result.

    Args:
        opened: the folder.
        analyse: flies the study, finishes the folder, returns the page; its data are the result.
        workers: processes of this machine; the cores that this process may use if None.
        scheduler: address of a Dask scheduler, in place of processes of this machine.
        progress: told the progress.
        stop: asked now and then; True ends it, with what was flown on disk.
        page: write page and result.

    Returns:
        The page; None: it was stopped.

    Raises:
        InputError: no flight can be flown, or the scheduler can't be reached.
        OSError: the folder can't be written.
    """
    study = opened.study
    began, before = time.monotonic(), opened.kept

    def keep(flown: Sequence[tuple[Task, FlightRow]]) -> None:
        opened.keep(flown)
        if progress is not None:
            rate = (opened.kept - before) / max(time.monotonic() - began, 1e-6)
            progress(opened.kept, (len(study.keys) - opened.kept) / rate)

    def fly(tasks: Iterable[Task], count: int) -> None:
        missing = (task for task in tasks if task.key not in opened.keys)
        fly_tasks(study, missing, count, keep, workers=workers, scheduler=scheduler, stop=stop)
        if stop is not None and stop():
            raise Stopped

    try:
        result = analyse(opened, fly)
    except Stopped:
        return None
    if page:
        from tombo_flight.report.html import write_page

        write_page(opened.folder / f"{study.kind}.html", result)
        opened.write_head(result.data)
    return result
