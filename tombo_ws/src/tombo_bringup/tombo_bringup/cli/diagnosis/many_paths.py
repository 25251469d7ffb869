"""An option that takes all paths that follow it, as a shell's pattern gives them."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

MANY = "--healthy"


class ManyPathsCommand(TyperCommand):
    """A command with the option --healthy OLD..., up to the next option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write --healthy before each of its paths."""
        return super().parse_args(ctx, spread_paths(args))


def spread_paths(args: list[str]) -> list[str]:
    """Return `--healthy A B --json` as `--healthy A --healthy B --json`."""
    found: list[str] = []
    taking = first = False
    for k, arg in enumerate(args):
        if arg == "--":
            return [*found, *args[k:]]
        if taking and not arg.startswith("-"):
            found += [arg] if first else [MANY, arg]
            first = False
            continue
        taking = first = arg == MANY
        found.append(arg)
    return found
