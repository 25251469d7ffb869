"""Whole numbers on the command line, refused by name and value."""

from __future__ import annotations

import typer


def parse_integer(text: object) -> int:
    """Return the whole number that an option's text means, for typer's `parser`.

    Raises:
        typer.BadParameter: it is none.
    """
    try:
        return int(str(text))
    except ValueError:
        raise typer.BadParameter(f"'{text}' is not a whole number") from None
