"""An option whose value may be left out: `--px4`, `--px4 URL`, `--px4=URL`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from typer.core import TyperCommand

OPTION = "--px4"
SIMULATED = "sim"
"""What the option stands for without a URL."""
_URL = re.compile(r"[A-Za-z][\w+.-]*://")


def with_url(words: Sequence[str]) -> list[str]:
    """Return a command line in which the option has a value.

    The word behind it is its value if it looks like a URL (`SCHEME://...`); any other is not.
    """
    found: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word == "--":
            return [*found, word, *rest]
        if word == OPTION:
            word = f"{OPTION}={rest.pop(0) if rest and _URL.match(rest[0]) else SIMULATED}"
        found.append(word)
    return found


class OptionalUrlCommand(TyperCommand):
    """A command with this option: spells it out before typer reads the words."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read a command line."""
        return super().parse_args(ctx, with_url(args))
