"""Command lines that are printed for a reader to run: each is built here."""

from __future__ import annotations

import shlex
from collections.abc import Sequence


def command_line(
    words: Sequence[str],
    options: Sequence[tuple[str, str | None]] = (),
    settings: Sequence[str] = (),
) -> str:
    """Return a command of the suite, quoted for the shell.

    Args:
        words: the command and its arguments, as in ("fly", "hover").
        options: with their values, as in ("--seed", "3"); one without a value (None or empty) is
            left out.
        settings: texts of --set.
    """
    line = ["tombo", *words]
    for name, value in [*options, *(("--set", text) for text in settings)]:
        line += [name, value] if value else []
    return shlex.join(line)
