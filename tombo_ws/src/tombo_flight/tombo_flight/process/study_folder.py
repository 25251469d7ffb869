"""The folder of a study of many flights: one process flies in it, and it goes on after a kill."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_flight.process.output_folder import make_numbered

OUTCOME = "outcome"
"""Key of the study's file that is no part of the study, as is `RESULT`."""
RESULT = "result"


class Journal:
    """Flights in a file of JSON lines, one a flight, written as they come."""

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
        """Put a flight on disk.

        Raises:
            OSError: it can't be written.
        """
        line = json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n"
        data = line.encode()
        try:
            written = os.write(self._file, data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, self._path) from error
        if written != len(data):  # the rest is cut off when the study goes on
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self._path)
        self.rows[row["flight"]] = row

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


@contextmanager
def open_study(
    folder: Path,
    head: str,
    values: Mapping[str, Any],
    *,
    numbered: bool = False,
    clear: Callable[[Path], bool],
) -> Iterator[Path]:
    """Open the folder of a study: a new or empty one, or that of the same study, to go on with.

    Args:
        folder: the folder; its parents are made as needed.
        head: name of the file that says what is flown.
        values: what is flown, in the types of JSON.
        numbered: make a new folder, with a number behind its name where that is taken.
        clear: called at the end of a study that began here; removes what it wrote and returns
            True where not one flight was flown.

    Raises:
        InputError: something else is in it, or another process flies it.
        OSError: it can't be written.
    """
    kind = head.removesuffix(".json")
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
                f"-o {folder}: another process flies this {kind}; accepted: another folder"
            ) from None
        begun = (folder / head).is_file()
        _check_same(folder, head, kind, values)
        try:
            yield folder
        finally:
            if not begun and clear(folder):
                (folder / head).unlink(missing_ok=True)
                if new:
                    with suppress(OSError):
                        folder.rmdir()
    finally:
        os.close(lock)


def read_head(folder: Path, head: str) -> dict[str, Any]:
    """Return what the study's file says.

    Raises:
        InputError: there is none.
    """
    kind = head.removesuffix(".json")
    try:
        values = json.loads((folder / head).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"'{folder / head}': {error}; accepted: a folder of a {kind}") from None
    if not isinstance(values, dict):
        raise InputError(f"'{folder / head}': no {kind}; accepted: a folder of a {kind}")
    return values


def write_head(folder: Path, head: str, values: Mapping[str, Any], outcome: str) -> None:
    """Write the study and how it stands into the folder, whole or not at all."""
    text = json.dumps({**values, OUTCOME: outcome}, indent=1, ensure_ascii=False)
    unfinished = folder / f".{head}.unfinished"
    unfinished.write_text(text + "\n", encoding="utf-8", newline="\n")
    os.replace(unfinished, folder / head)


def _check_same(folder: Path, head: str, kind: str, values: Mapping[str, Any]) -> None:
    """Refuse a folder with other things; in a new one write what is going to be flown."""
    if not (folder / head).is_file():
        names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if names:
            raise InputError(
                f"-o {folder}: it is not empty ({', '.join(names[:3])}); accepted: a new or empty "
                f"folder, or one of the same {kind}, which then goes on"
            )
        write_head(folder, head, values, "")
        return
    there = read_head(folder, head)
    keys = {*there, *values} - {OUTCOME, RESULT}
    other = sorted(key for key in keys if there.get(key) != values.get(key))
    if other:
        raise InputError(
            f"-o {folder}: a {kind} with another {', another '.join(other)} was begun in it; "
            f"accepted: the same {kind}, which then goes on, or another folder"
        )
