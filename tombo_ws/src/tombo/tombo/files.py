"""Files that are written whole or not at all, and replace nothing unasked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tombo_dynamics.errors import InputError


@contextmanager
def new_file(path: str | Path, *, replace: bool) -> Iterator[Path]:
    """Give the name of a hidden file beside `path`, which is put in its place at the end.

    Raises:
        InputError: it is there and may not be replaced, or can't be written.
    """
    target = Path(path)
    if os.path.lexists(target) and not replace:
        raise InputError(f"'{target}' exists; accepted: another name, or replace=True")
    unfinished = target.with_name(f".{target.name}.unfinished-{os.getpid()}")
    try:
        yield unfinished
        if replace:
            os.replace(unfinished, target)
        else:
            os.link(unfinished, target)  # unlike a rename it never replaces
    except OSError as error:
        raise InputError(
            f"'{target}' can't be written ({error.strerror}); accepted: a new file in a folder "
            "that can be written"
        ) from error
    finally:
        unfinished.unlink(missing_ok=True)
