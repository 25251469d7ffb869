"""What the tables and texts of several commands share on the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Column
from rich.text import Text


def right(*headings: str, **more: Any) -> list[Column]:
    """Return columns of numbers."""
    return [Column(heading, justify="right", **more) for heading in headings]


def print_line(text: str, style: str = "") -> None:
    """Print a line, however long it gets."""
    Console().print(Text(text, style), soft_wrap=True)
