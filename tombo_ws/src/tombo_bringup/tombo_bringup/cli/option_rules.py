"""Which options of a command go together: a table, and the check of what was given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tombo_dynamics.errors import InputError


@dataclass(frozen=True)
class OptionRule:
    """What one option needs beside it, and what it can't be combined with."""

    shown: str
    """The option in a message; a name of a parameter in braces stands for its value."""
    option: str
    """Name of its parameter."""
    needs: tuple[str, ...] = ()
    """Options, one of which must be given."""
    without: tuple[str, ...] = ()
    """Options, none of which may be given."""
    accepted: str = ""
    """What is accepted, in words; empty: it follows from `needs` and `without`."""

    def check(self, given: Mapping[str, Any]) -> None:
        """Refuse a combination.

        Raises:
            InputError: the rule is broken.
        """
        if not is_given(given[self.option]):
            return
        lacks = self.needs and not any(is_given(given[name]) for name in self.needs)
        if lacks or any(is_given(given[name]) for name in self.without):
            accepted = self.accepted or self._words()
            raise InputError(f"{self.shown.format_map(given)}: accepted: {accepted}")

    def _words(self) -> str:
        parts = []
        if self.needs:
            parts.append(f"with {_flags(self.needs, 'or')}{'' if self.without else ' only'}")
        if self.without:
            parts.append(f"without {_flags(self.without, 'and')}")
        return " and ".join(parts)


def is_given(value: Any) -> bool:
    """Return whether an option is given: zero is a value, False and an empty list are none."""
    return value is not None and value is not False and value != []


def check_options(rules: Sequence[OptionRule], given: Mapping[str, Any]) -> None:
    """Refuse options that don't go together, by the first rule that they break.

    Args:
        rules: of the command.
        given: name of a parameter → its value.

    Raises:
        InputError: there are some.
    """
    for rule in rules:
        rule.check(given)


def _flags(names: Sequence[str], last: str) -> str:
    flags = [f"--{name.replace('_', '-')}" for name in names]
    return f" {last} ".join([", ".join(flags[:-1]), flags[-1]] if len(flags) > 1 else flags)
