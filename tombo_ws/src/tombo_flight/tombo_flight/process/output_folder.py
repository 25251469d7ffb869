"""Files, and a folder of results, that appear whole or not at all.

Files are written into a hidden folder on the same file system and moved in place at the end. Other
files in the folder stay. A folder that is numbered belongs to one run alone: it is made at the
start, and where its name is taken, -2, -3 and so on follow it.
"""

from __future__ import annotations

import errno
import itertools
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
        raise OSError(errno.EINVAL, "it is no file", str(path))
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


def make_parents(path: Path) -> list[Path]:
    """Make the parents of a path that are not there, and return them, the outermost first.

    Raises:
        OSError: they can't be made; none is left.
    """
    made: list[Path] = []
    try:
        for parent in reversed([p for p in path.parents if not p.exists()]):
            parent.mkdir(exist_ok=True)
            made.append(parent)
    except OSError:
        remove_empty(made)
        raise
    return made


def remove_empty(folders: Sequence[Path]) -> None:
    """Remove folders, the last first, up to one that is not empty."""
    for folder in reversed(folders):
        try:
            folder.rmdir()
        except OSError:
            return


class OutputFolder:
    """Results before they are moved into a folder; see `open_output`."""

    def __init__(
        self,
        target: Path,
        shown: Path,
        *,
        replace: bool,
        results: Sequence[str] = RESULT_FILES,
        numbered: bool = False,
    ) -> None:
        self.path = shown
        """The folder as the user named it, with its number."""
        self._results = results
        self._target = target
        self._replace = replace
        self._numbered = numbered
        self._made: list[Path] = []
        try:
            if numbered:
                self._made += make_parents(target)
                self._take(make_numbered(target))
            self._inside = target.is_dir() and not numbered
            if not numbered:
                self._refuse_unsuitable()
            self.staging = self._make_staging()
        except OSError as error:
            remove_empty(self._made)
            raise self._unwritable(error) from error
        self._published = False

    def __truediv__(self, name: str) -> Path:
        """Return where to write the file `name` for now."""
        return self.staging / name

    def publish(self) -> None:
        """Move the written files into the folder, in place of those of an earlier run.

        Raises:
            InputError: another program has filled the folder meanwhile; the results are then in a
            numbered folder next to it.
            OSError: it can't be written any more.
        """
        if not self._inside:
            try:
                self._rename()
                return
            except OSError:
                if not self._target.is_dir():
                    raise
        try:
            if self._numbered:
                raise InputError("taken")
            self._refuse_unsuitable()
        except InputError as error:
            self._take(make_numbered(self._target))
            self._rename()
            if not self._numbered:
                raise InputError(f"{error}; the results are in '{self.path}'") from None
            return
        for name in self._results:
            (self._target / name).unlink(missing_ok=True)
        for path in sorted(p for p in self.staging.rglob("*") if not p.is_dir()):
            place = self._target / path.relative_to(self.staging)
            place.parent.mkdir(exist_ok=True)
            os.replace(path, place)
        shutil.rmtree(self.staging)
        self._published = True

    def _take(self, made: Path) -> None:
        """Go on with a folder that was made for this run."""
        self._target = made
        self.path = self.path.with_name(made.name)
        self._made.append(made)

    def _rename(self) -> None:
        """Put the whole hidden folder in place of none, or of an empty one."""
        os.rename(self.staging, self._target)
        self._published = True

    def discard(self) -> None:
        """Remove everything that was made, unless it has been published."""
        if not self._published:
            shutil.rmtree(self.staging, ignore_errors=True)
            remove_empty(self._made)

    def _make_staging(self) -> Path:
        """Make the hidden folder: inside the target if that exists, else in its parent folder."""
        if self._inside:
            staging = self._target / f".tombo-{secrets.token_hex(4)}"
        else:
            self._made += make_parents(self._target)
            staging = self._target.parent / f".{self._target.name}-{secrets.token_hex(4)}"
        staging.mkdir()
        return staging

    def _refuse_unsuitable(self) -> None:
        if not os.path.lexists(self._target):
            return
        if not self._target.is_dir():
            raise InputError(
                f"output folder '{self.path}': it is a file; accepted: a folder, new or empty"
            )
        names = sorted(p.name for p in self._target.iterdir() if not self._is_staging(p))
        if names and not self._replace:
            some = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
            raise InputError(
                f"output folder '{self.path}': it is not empty ({some}); accepted: a new or empty "
                "folder, or --force to replace the results in it"
            )
        for name in self._results:
            path = self._target / name
            if path.parent != self._target and path.parent.exists() and not path.parent.is_dir():
                raise InputError(
                    f"output folder '{self.path}': {path.parent.name} in it is a file; accepted: "
                    "a folder in which that name is free, or is a folder"
                )
            if path.is_dir() and not path.is_symlink():
                raise InputError(
                    f"output folder '{self.path}': {name} in it is a folder; accepted: a folder "
                    "in which that name is free"
                )

    def _is_staging(self, path: Path) -> bool:
        return path == getattr(self, "staging", None)

    def full(self, error: OSError) -> InputError:
        """Return the message for a full disk."""
        written = sum(p.stat().st_size for p in self.staging.rglob("*") if p.is_file())
        free = shutil.disk_usage(self.staging).free
        return InputError(
            f"output folder '{self.path}': {error.strerror}: {written / 1e6:.1f} MB of this run "
            f"are written, {free / 1e6:.1f} MB are free; accepted: a folder on a disk with room"
        )

    def _unwritable(self, error: OSError) -> InputError:
        reason = error.strerror or str(error)
        return InputError(
            f"output folder '{self.path}': it can't be written ({reason}); accepted: a folder, "
            "new or empty, in a place that can be written"
        )


def _beside(path: Path) -> Path:
    """Return the path with the links of its parents followed, not its own: that name is taken."""
    return Path(os.path.realpath(path.parent)) / path.name


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
        InputError: a file, not empty and `replace` is False, or not writable.
    """
    if os.path.islink(path) and not os.path.exists(path) and not numbered:
        raise InputError(
            f"output folder '{path}': it is a link to '{os.readlink(path)}', which does not "
            "exist; accepted: a folder, new or empty"
        )
    folder = OutputFolder(
        _beside(path) if numbered else Path(os.path.realpath(path)),
        path,
        replace=replace,
        results=results,
        numbered=numbered,
    )
    try:
        yield folder
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise folder.full(error) from error
        raise
    finally:
        folder.discard()
