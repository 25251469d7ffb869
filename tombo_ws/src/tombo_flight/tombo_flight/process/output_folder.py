"""Files, and a folder of results, that appear whole or not at all.

Files are written into a hidden folder inside and moved up at the end. Other files in the folder
stay. A folder that is numbered belongs to one run alone: where its name is taken, -2, -3 and so on
follow it.
"""

from __future__ import annotations

import errno
import itertools
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from tombo_dynamics.errors import InputError

RESULT_FILES = (
    *("flight.mcap", "summary.json", "flight.png", "report.html", "nodes.log", "scenario.yaml"),
)
"""All names that a flight writes; a new run replaces those of an earlier one."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to; the written file replaces `path` at the end.

    After an error nothing new is left.

    Raises:
        OSError: it can't be written, or is not a file but a device or a folder.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is not a file", str(path))
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        yield unfinished
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text in UTF-8.

    Raises:
        OSError: it can't be written.
    """
    with whole_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8", newline="\n")


def make_numbered(path: Path) -> Path:
    """Make the folder, or the first of PATH-2, PATH-3 and so on that is free, and return it.

    Two runs at once never get the same one. The parents must be there.

    Raises:
        OSError: it can't be written.
    """
    for number in itertools.count(1):
        found = path if number == 1 else path.with_name(f"{path.name}-{number}")
        try:
            found.mkdir()
        except FileExistsError:
            continue
        return found
    raise AssertionError


def make_folder(path: Path, *, numbered: bool) -> tuple[Path, list[Path]]:
    """Make a folder with its parents; return it, and the new folders, the innermost first.

    Args:
        path: the folder; it may be there.
        numbered: make a new one, see `make_numbered`.

    Raises:
        OSError: it can't be written; nothing new is left.
    """
    made = [place for place in (path, *path.parents) if not os.path.lexists(place)]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if numbered:
            path = make_numbered(path)
            made.insert(0, path)
        path.mkdir(exist_ok=True)
    except OSError:
        remove_empty(made)
        raise
    return path, made


class OutputFolder:
    """Results before they are moved into a folder; see `open_output`."""

    def __init__(self, path: Path, results: Sequence[str], *, replace: bool) -> None:
        self.path = path
        self._replace = replace
        self.staging = path / f".tombo-{secrets.token_hex(4)}"
        self._results = results
        self.staging.mkdir()

    def __truediv__(self, name: str) -> Path:
        """Return where to write the file `name` for now."""
        return self.staging / name

    def publish(self) -> None:
        """Move the written files into the folder, in place of those of an earlier run.

        Where another program has filled it meanwhile, they go to a numbered one next to it.

        Raises:
            OSError: it can't be written any more.
        """
        if not self._replace and any(path != self.staging for path in self.path.iterdir()):
            self.path = make_numbered(self.path)
        for name in self._results:
            (self.path / name).unlink(missing_ok=True)
        for path in sorted(p for p in self.staging.rglob("*") if not p.is_dir()):
            place = self.path / path.relative_to(self.staging)
            place.parent.mkdir(exist_ok=True)
            os.replace(path, place)
        shutil.rmtree(self.staging)


@contextmanager
def open_output(
    path: Path, *, replace: bool, results: Sequence[str] = RESULT_FILES, numbered: bool = False
) -> Iterator[OutputFolder]:
    """Prepare a folder of results now, so that it is known to be writable.

    Within the context, write files to `folder / name` and end with `folder.publish()`; without
    that, or after an error, nothing is left.

    Args:
        path: the folder; its parents are made as needed.
        replace: whether results of an earlier run may be replaced, and other files be there.
        results: names, at most one folder deep, that a new run replaces.
        numbered: make a new folder, with a number behind its name where that is taken, so that
            nothing is replaced; its name is then `folder.path`.

    Raises:
        InputError: a file, not empty and `replace` is False, or not writable; the disk is full.
    """
    if not numbered and os.path.lexists(path) and not os.path.isdir(path):
        raise InputError(f"output folder '{path}': it is a file; accepted: a folder, new or empty")
    made: list[Path] = []
    try:
        path, made = make_folder(path, numbered=numbered)
        names = sorted(inside.name for inside in path.iterdir())
        if names and not replace:
            raise InputError(
                f"output folder '{path}': it is not empty ({', '.join(names[:3])}); accepted: a "
                "new or empty folder, or --force to replace the results in it"
            )
        folder = OutputFolder(path, results, replace=replace)
    except OSError as error:
        remove_empty(made)
        raise InputError(
            f"output folder '{path}': it can't be written ({error.strerror}); accepted: a folder, "
            "new or empty, in a place that can be written"
        ) from error
    try:
        yield folder
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise InputError(
                f"output folder '{path}': {error.strerror}; accepted: a folder on a disk with room"
            ) from error
        raise
    finally:
        shutil.rmtree(folder.staging, ignore_errors=True)
        remove_empty(made)


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove those folders that are empty, in this order."""
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()
