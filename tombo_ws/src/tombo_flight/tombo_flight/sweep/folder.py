"""The folder of a sweep: one process flies in it, and it goes on after a kill.

Each batch of flights is a Parquet file in `parts/` as soon as it is flown; at the end all are
joined to `flights.parquet`. The table does not depend on the number of interruptions.
"""

from __future__ import annotations

import fcntl
import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_flight.json_text import as_json
from tombo_flight.process.output_folder import (
    RESULT_FILES,
    make_numbered,
    make_parents,
    remove_empty,
    whole_file,
    write_whole,
)
from tombo_flight.process.study import FlightRow, Flown, Task
from tombo_flight.sweep.study import SweepStudy

if TYPE_CHECKING:
    import pyarrow as pa

HEAD = "sweep.json"
PAGE = "sweep.html"
TABLE = "flights.parquet"
PARTS = "parts"
KEY = "flight"
"""Column of the number of a flight."""
OUTCOME = "outcome"
"""Key of the head that does not belong to the study, like `RESULT`."""
RESULT = "result"
_UNITS = {"rad": "rad", "m": "m", "s": "s", "n": "N"}
"""Ending of a figure's name → unit."""


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
            flights = self._read(path, [KEY]).column(KEY).to_numpy()
            if self.is_kept[flights].all():  # killed after the table was written
                path.unlink()
            self.is_kept[flights] = True

    @property
    def table(self) -> Path:
        """The file with all flights, at the end."""
        return self.folder / TABLE

    @property
    def kept(self) -> int:
        """Number of flights that are on disk."""
        return int(self.is_kept.sum())

    def missing(self) -> Iterator[Task]:
        """Yield the flights that are not on disk."""
        for flight in np.flatnonzero(~self.is_kept).tolist():
            yield Task(flight, *self.study.place(flight))

    def keep(self, flown: Flown) -> None:
        """Put a batch of flights on disk, in a file that is named by the first.

        Raises:
            OSError: it can't be written.
        """
        import pyarrow.parquet as pq

        rows = [
            {KEY: task.key, "seed": task.seed, **self.study.labels(task.point), **row}
            for task, row in flown
        ]
        parts = self.folder / PARTS
        parts.mkdir(exist_ok=True)
        with whole_file(parts / f"{rows[0][KEY]:09d}.parquet") as unfinished:
            pq.write_table(self._table_of(rows), unfinished)
        self.is_kept[[row[KEY] for row in rows]] = True

    def finish(self) -> None:
        """Join all flights into one table, in their order.

        Raises:
            InputError: a part can't be read.
            OSError: the table can't be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        files = self._files()
        if files != [self.table]:
            table = pa.concat_tables([self._read(path) for path in files]).sort_by(KEY)
            with whole_file(self.table) as unfinished:
                pq.write_table(table, unfinished)
            shutil.rmtree(self.folder / PARTS)

    def columns(self, names: Sequence[str]) -> dict[str, np.ndarray[Any, Any]]:
        """Return columns of the table: floats (NaN: none), or texts (None: none)."""
        read = self._read(self.table, names)
        kinds = self.study.columns()
        return {
            name: read.column(name).to_numpy()
            if kinds[name] == "text"
            else read.column(name).cast("double").to_numpy()
            for name in names
        }

    def write_head(self, result: Mapping[str, Any] | None = None) -> None:
        """Write the study, and at the end its result."""
        more = {} if result is None else {RESULT: result}
        outcome = "" if result is None else result[OUTCOME]
        values = {**self.study.as_mapping(), **more, OUTCOME: outcome}
        write_whole(self.folder / HEAD, as_json(values))

    def remove_flights(self) -> None:
        """Remove all flights that are on disk."""
        shutil.rmtree(self.folder / PARTS, ignore_errors=True)
        self.table.unlink(missing_ok=True)
        self.is_kept[:] = False

    def _files(self) -> list[Path]:
        parts = sorted((self.folder / PARTS).glob("[0-9]*.parquet"))
        return [*([self.table] if self.table.is_file() else []), *parts]

    def _table_of(self, rows: Sequence[FlightRow]) -> pa.Table:
        """Return rows as a table. By way of JSON, as `pa.array` would import pandas first."""
        from pyarrow.json import ParseOptions, read_json

        schema = self._schema()
        lines = "\n".join(json.dumps(row, default=lambda value: value.tolist()) for row in rows)
        options = ParseOptions(explicit_schema=schema, unexpected_field_behavior="error")
        read = read_json(io.BytesIO(lines.encode()), parse_options=options)
        return read.select(schema.names).cast(schema)

    def _read(self, path: Path, columns: Sequence[str] | None = None) -> pa.Table:
        import pyarrow as pa
        import pyarrow.parquet as pq

        names = list(columns or self.study.columns())
        try:
            with pq.ParquetFile(path) as file:  # `read_table` loads much more of pyarrow
                read = file.read(names)
            return read.select(names) if columns else read.select(names).cast(self._schema())
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise InputError(
                f"'{path}' has no flights of this sweep: {error}; accepted: another folder, or "
                "without this file: its flights are flown again"
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
            unit = _UNITS.get(name.rpartition("_")[2])
            fields.append(pa.field(name, kinds[kind], metadata={"unit": unit} if unit else None))
        text = json.dumps(self.study.as_mapping(), ensure_ascii=False)
        return pa.schema(fields, metadata={"tombo": text})


@contextmanager
def open_sweep(
    folder: Path, study: SweepStudy, *, numbered: bool = False, again: bool = False
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep: a new or empty one, or that of the same sweep, to go on with.

    A new one, with the parents made for it, is gone again where not one flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        study: what is flown.
        numbered: make a new folder, with a number behind its name where that is taken.
        again: remove the results that are in the folder, of whatever was flown.

    Raises:
        InputError: something else is in it, or another process flies it.
    """
    new = numbered or not folder.exists()
    made: list[Path] = []
    try:
        made += make_parents(folder)
        if numbered:
            folder = make_numbered(folder)
        else:
            folder.mkdir(exist_ok=True)
        made += [folder] if new else []
    except OSError as error:
        remove_empty(made)
        raise InputError(
            f"-o {folder}: can't be written ({error.strerror}); accepted: a folder, new or empty"
        ) from error
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"-o {folder}: another process flies this sweep; accepted: another folder"
            ) from None
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
            if not begun and not opened.kept:
                (folder / HEAD).unlink(missing_ok=True)
                opened.remove_flights()
                remove_empty(made)
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
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"'{path}': {error}; accepted: a folder of a sweep") from None
    if not isinstance(values, dict):
        raise InputError(f"'{path}': no sweep; accepted: a folder of a sweep")
    return values
