"""The folder of a sweep: what is flown is on disk at once, and joined into one table at the end.

Flights are kept in blocks. A block that is not whole is a file of JSON lines, one a flight,
written as they come; a whole one is sorted into a Parquet file. So memory holds a block or two, a
process that is killed loses no flight that was over, and the table does not depend on the order.
"""

from __future__ import annotations

import dataclasses
import errno
import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_flight.process.output_folder import make_numbered
from tombo_flight.sweep.study import Study, study_of

STUDY_FILE = "sweep.json"
TABLE = "flights.parquet"
PAGE = "sweep.html"
PARTS = "parts"
BLOCK = 10_000
"""Flights of a part."""


class Store:
    """The flights of a study in a folder; see `open_store`."""

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study
        self._parts = folder / PARTS
        self._open: dict[int, _Block] = {}
        self.kept = 0
        """Flights that are on disk."""
        if self.finished:
            self.kept = study.flights
            return
        self._parts.mkdir(exist_ok=True)
        for number in range(self.blocks):
            if self._whole(number).is_file():
                self._journal(number).unlink(missing_ok=True)
                self.kept += len(self._flights_of(number))
            elif self._journal(number).is_file():
                self.kept += len(self._block(number).rows)

    @property
    def finished(self) -> bool:
        """Whether the table is there."""
        return (self.folder / TABLE).is_file()

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.study.flights // BLOCK)

    def missing(self) -> Iterator[int]:
        """Yield the flights that are not on disk, in their order."""
        for number in range(self.blocks):
            if not self._whole(number).is_file():
                there = set(self._block(number).rows)
                yield from (flight for flight in self._flights_of(number) if flight not in there)

    def keep(self, row: Mapping[str, Any]) -> None:
        """Put a flight on disk.

        Raises:
            OSError: it can't be written.
        """
        number = row["flight"] // BLOCK
        block = self._block(number)
        block.append(row)
        self.kept += 1
        if len(block.rows) == len(self._flights_of(number)):
            self._seal(number)

    def finish(self) -> None:
        """Join the parts into the table, in the order of the flights.

        Raises:
            OSError: it can't be written.
        """
        import pyarrow.parquet as pq

        from tombo_flight.sweep.columns import schema_of

        unfinished = self.folder / f".{TABLE}.unfinished"
        with pq.ParquetWriter(unfinished, schema_of(self.study)) as writer:
            for number in range(self.blocks):
                writer.write_table(pq.read_table(self._whole(number)))
        os.replace(unfinished, self.folder / TABLE)
        shutil.rmtree(self._parts)

    def _seal(self, number: int) -> None:
        """Put a whole block into its part, which takes the place of its lines."""
        import pyarrow.parquet as pq

        from tombo_flight.sweep.columns import schema_of, table_of

        block = self._open.pop(number)
        rows = [block.rows[flight] for flight in sorted(block.rows)]
        unfinished = self._parts / f".{number:06d}.unfinished"
        pq.write_table(table_of(rows, self.study, schema_of(self.study)), unfinished)
        os.replace(unfinished, self._whole(number))
        block.close()
        self._journal(number).unlink()

    def _block(self, number: int) -> _Block:
        if number not in self._open:
            self._open[number] = _Block(self._journal(number))
        return self._open[number]

    def _flights_of(self, number: int) -> range:
        return range(number * BLOCK, min((number + 1) * BLOCK, self.study.flights))

    def _whole(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _journal(self, number: int) -> Path:
        return self._parts / f"{number:06d}.jsonl"

    def close(self) -> None:
        """Close all files."""
        for block in self._open.values():
            block.close()

    def remove(self, folder: Path | None) -> None:
        """Remove what was written, and the folder itself if given and empty."""
        shutil.rmtree(self._parts, ignore_errors=True)
        (self.folder / STUDY_FILE).unlink(missing_ok=True)
        if folder is not None:
            with suppress(OSError):
                folder.rmdir()


class _Block:
    """Flights of a block that is not whole, and their file."""

    def __init__(self, path: Path) -> None:
        self.rows: dict[int, Mapping[str, Any]] = {}
        whole = 0
        if path.is_file():
            for line in path.read_bytes().splitlines(keepends=True):
                if not line.endswith(b"\n"):  # cut off when the process was killed
                    break
                row = json.loads(line)
                self.rows[row["flight"]] = row
                whole += len(line)
            os.truncate(path, whole)
        self._path = str(path)
        self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)

    def append(self, row: Mapping[str, Any]) -> None:
        line = json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n"
        data = line.encode()
        try:
            written = os.write(self._file, data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, self._path) from error
        if written != len(data):  # the rest is cut off when the sweep goes on
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self._path)
        self.rows[row["flight"]] = row

    def close(self) -> None:
        os.close(self._file)


@contextmanager
def open_store(folder: Path, study: Study, *, numbered: bool = False) -> Iterator[Store]:
    """Open the folder of a sweep: a new or empty one, or that of the same sweep, to go on with.

    A new one is gone again where not one flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        study: what is flown.
        numbered: make a new folder, with a number behind its name where that is taken.

    Raises:
        InputError: something else is in it, or another process flies it.
        OSError: it can't be written.
    """
    new = numbered or not folder.exists()
    if numbered:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder = make_numbered(folder)
    else:
        folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"-o {folder}: another process flies this sweep; accepted: another folder"
            ) from None
        begun = (folder / STUDY_FILE).is_file()
        _check_same(folder, study)
        store = Store(folder, study)
        try:
            yield store
        finally:
            store.close()
            if not begun and store.kept == 0:
                store.remove(folder if new else None)
    finally:
        os.close(lock)


def read_study(folder: Path) -> Study:
    """Return the study of a folder.

    Raises:
        InputError: there is none in it.
    """
    return study_of(_read(folder))


def write_outcome(folder: Path, study: Study, outcome: str) -> None:
    """Write the study and how it stands into the folder, whole or not at all."""
    text = json.dumps({**study.as_mapping(), "outcome": outcome}, indent=1, ensure_ascii=False)
    unfinished = folder / f".{STUDY_FILE}.unfinished"
    unfinished.write_text(text + "\n", encoding="utf-8", newline="\n")
    os.replace(unfinished, folder / STUDY_FILE)


def _read(folder: Path) -> dict[str, Any]:
    try:
        values = json.loads((folder / STUDY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"'{folder / STUDY_FILE}': {error}; accepted: a folder of a sweep"
        ) from None
    if not isinstance(values, dict):
        raise InputError(f"'{folder / STUDY_FILE}': no sweep; accepted: a folder of a sweep")
    return values


def _check_same(folder: Path, study: Study) -> None:
    """Refuse a folder with other things; in a new one write what is going to be flown."""
    if not (folder / STUDY_FILE).is_file():
        names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if names:
            raise InputError(
                f"-o {folder}: it is not empty ({', '.join(names[:3])}); accepted: a new or empty "
                "folder, or one of the same sweep, which then goes on"
            )
        write_outcome(folder, study, "")
        return
    there, asked = read_study(folder), study
    if there.as_mapping() == asked.as_mapping():
        return
    other = [
        field.name
        for field in dataclasses.fields(study)
        if getattr(there, field.name) != getattr(asked, field.name)
    ]
    raise InputError(
        f"-o {folder}: a sweep with another {', another '.join(other)} was begun in it; accepted: "
        "the same sweep, which then goes on, or another folder"
    )
