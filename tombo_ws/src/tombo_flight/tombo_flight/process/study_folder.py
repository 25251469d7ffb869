"""The folder of a study of many flights: one process flies in it, and it goes on after a kill."""

from __future__ import annotations

import fcntl
import json
import os
from collections import UserDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tombo_dynamics.errors import InputError, shown
from tombo_flight.process.output_folder import make_numbered
from tombo_flight.whole_file import write_whole

OUTCOME = "outcome"
"""Key of the study's file that is no part of the study, as is `RESULT`."""
RESULT = "result"


class Journal(UserDict[Any, dict[str, Any]]):
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
            if kept_run != run:
                raise InputError(
                    f"'{path}' is of {shown(kept_run)}, this is {shown(run)}; accepted: the same "
                    "command and seed, or another -o"
                )
            self.data[key] = row

    def __setitem__(self, key: Any, row: dict[str, Any]) -> None:
        """Append a row.

        Raises:
            OSError: it can't be written.
        """
        text = json.dumps([self._run, key, row], default=_number)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write("\n" + text)  # a line that a kill has cut ends here
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.path)) from error
        self.data[key] = row


def _number(value: Any) -> Any:
    """Return a number or list of numpy as Python's own."""
    return value.tolist()


class KeptFlights(Protocol):
    """The flights of a study that are on disk, in its folder."""

    @property
    def kept(self) -> int:
        """Their number."""
        ...

    def remove(self) -> None:
        """Remove what was written, where not one flight was flown."""
        ...


_KeptFlights = TypeVar("_KeptFlights", bound=KeptFlights)


@contextmanager
def open_study(
    folder: Path,
    head: str,
    values: Mapping[str, Any],
    opened: Callable[[Path], _KeptFlights],
    *,
    numbered: bool = False,
) -> Iterator[_KeptFlights]:
    """Open the folder of a study: a new or empty one, or that of the same study, to go on with.

    A new one is gone again where not one flight was flown.

    Args:
        folder: the folder; its parents are made as needed.
        head: name of the file that says what is flown.
        values: what is flown, in the types of JSON.
        opened: reads the flights that are in the folder.
        numbered: make a new folder, with a number behind its name where that is taken.

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
        store = None
        try:
            store = opened(folder)
            yield store
        finally:
            if not begun and (store is None or not store.kept):
                if store is not None:
                    store.remove()
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
    write_whole(folder / head, text + "\n")


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
