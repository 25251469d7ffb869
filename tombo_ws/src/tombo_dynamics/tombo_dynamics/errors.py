"""The one exception for input that can't be used, and how a value is shown in it."""

from __future__ import annotations

import difflib
import itertools
import pkgutil
import reprlib
from collections.abc import Collection, Iterable
from importlib import import_module
from pathlib import Path

_LONGEST = 4000
"""Characters of a message."""
_MOST_NAMES = 200
"""Names that are compared or listed."""
_NAME = 100
"""Characters that are shown of a name."""
_OTHER_WORDS = {"waypoints": "course", "trajectory": "course", "path": "course"}
"""What other software calls a thing → its name here."""


class InputError(ValueError):
    """Bad input: the message names the input, its value and the accepted values, in one line."""

    def __init__(self, message: str) -> None:
        super().__init__(_truncate(message, _LONGEST))


_short = reprlib.Repr()
_short.maxlevel, _short.maxdict, _short.maxlist, _short.maxtuple = 4, 12, 12, 12
_short.maxstring = _short.maxother = 2 * _NAME


def shown(value: object, limit: int = 60) -> str:
    """Return a value as Python writes it, cut before the text is built, for an error message."""
    return _truncate(_short.repr(value), limit)


def shown_names(names: Iterable[object], most: int = _MOST_NAMES) -> str:
    """Return names parted by commas; of many the first, of long ones the start."""
    cut_names = [_truncate(str(name), _NAME) for name in itertools.islice(names, most + 1)]
    return ", ".join(cut_names[:most] + ["…"] * (len(cut_names) > most))


def unknown_name(what: str, value: object, accepted: Iterable[object]) -> InputError:
    """Build the error for a name that is not in a list, with the closest match if there is one."""
    names = sorted(map(str, accepted))
    text = value if isinstance(value, str) else shown(value, _NAME)
    text = _truncate(text, _NAME)
    short = (name for name in names if len(name) <= _NAME)
    close = difflib.get_close_matches(text, itertools.islice(short, _MOST_NAMES), n=1)
    if _OTHER_WORDS.get(text) in names:
        close = [_OTHER_WORDS[text]]
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return InputError(f"unknown {what} '{text}'{hint}; accepted: {shown_names(names)}")


def _truncate(text: str, limit: int) -> str:
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def problem_in(error: Exception, file: Path | None = None) -> str:
    """Return an exception of the user's code in a line: its type, text and place.

    Args:
        error: the exception.
        file: whose lines are meant; None: where it was raised.
    """
    lines, where = str(error).splitlines(), ""
    if type(error).__module__.startswith("numba"):  # the first line names the compiler's step
        where = "".join(f" ({line.strip()})" for line in lines if line.startswith("File "))
        lines = [line for line in lines[1:] if line.strip()] or lines
        return f"{type(error).__name__}: {lines[0]}{where.replace(':)', ')')}"
    text = shown(str(error)) if str(error) else "no text"
    if isinstance(error, SyntaxError) and error.lineno is not None:
        where = f" (line {error.lineno})"
    trace = error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if file is None or code.co_filename == str(file):
            where = f" ({Path(code.co_filename).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return f"{type(error).__name__}: {text}{where}"


def import_each(package: str, folders: Iterable[str], but: Collection[str] = ()) -> None:
    """Import all modules of a package, for their entries in a registry.

    Args:
        package: dotted name.
        folders: its `__path__`.
        but: modules that are left out.

    Raises:
        InputError: one fails; the error names its file.
    """
    for module in sorted(pkgutil.iter_modules(folders), key=lambda module: module.name):
        if module.name in but:
            continue
        try:
            import_module(f"{package}.{module.name}")
        except Exception as error:
            file = Path(getattr(module.module_finder, "path", "")) / f"{module.name}.py"
            raise InputError(
                f"'{file}': {problem_in(error, file)}; accepted: a file that Python can import"
            ) from error
