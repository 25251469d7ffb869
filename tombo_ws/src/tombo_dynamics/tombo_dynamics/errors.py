"""The one exception that means: what was given can't be used."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Bad input: the message names the input, the value and what is accepted, in one line."""


def unknown_name(what: str, value: object, accepted: Iterable[str]) -> InputError:
    """Build the error for a name that is not in a list, with the closest match if there is one."""
    names = sorted(accepted)
    close = difflib.get_close_matches(str(value), names, n=1)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return InputError(f"unknown {what} '{value}'{hint}; accepted: {', '.join(names)}")
