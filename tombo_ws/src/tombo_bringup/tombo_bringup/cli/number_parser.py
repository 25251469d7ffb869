"""Numbers on the command line, refused with what is accepted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer


def number_parser(
    accepted: str | Callable[[], str], kind: type[float] = float
) -> Callable[[object], Any]:
    """Return a `parser` for typer: the number that an option's text means.

    Args:
        accepted: what is, or who knows it: asked only of text that is refused.
        kind: float or int.
    """

    def number(text: object) -> Any:
        try:
            return kind(str(text))
        except ValueError:
            words = accepted if isinstance(accepted, str) else accepted()
            raise typer.BadParameter(f"'{text}'; accepted: {words}") from None

    return number
