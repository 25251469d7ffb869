"""The one place where an exception becomes a line on standard error and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import typer

from tombo_dynamics.errors import InputError

BAD_INPUT = 2
"""Exit code of bad input, of output that can't be written and of a wrong command line."""
INTERRUPTED = 130
BROKEN_PIPE = 141

_UsageError: type[Exception] = next(
    kind
    for kind in reversed(typer.BadParameter.__mro__)
    if issubclass(kind, Exception) and hasattr(kind, "format_message")
)
"""What typer raises for a wrong command line: the class differs between its versions."""


def exit_code_of(command: Callable[[], object]) -> int:
    """Run a command and return its exit code; bad input becomes one line on standard error.

    An exception that is none of these is a bug and passes through with its traceback.
    """
    try:
        result = command()
        if sys.stdout is not None:  # None: closed before the start
            sys.stdout.flush()
    except typer.Exit as leave:
        return int(leave.exit_code)
    except InputError as error:
        print_error(str(error))
    except _UsageError as error:
        if text := _usage(error):  # empty: help was shown
            print_error(text)
    except (KeyboardInterrupt, typer.Abort):
        print_error("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        _discard_stdout()
        return BROKEN_PIPE
    except MemoryError:
        print_error("there is not enough memory for what this file holds; accepted: a smaller one")
    except OSError as error:
        where = f"'{error.filename}': " if error.filename else ""
        print_error(f"{where}{error.strerror or error}")
    else:
        return result if isinstance(result, int) else 0
    return BAD_INPUT


def _usage(error: Any) -> str:
    """Return the error in a command line; for an unknown command with the accepted ones."""
    message = str(error.format_message())
    context: Any = getattr(error, "ctx", None)
    group: Any = getattr(context, "command", None)
    if "No such command" in message and hasattr(group, "list_commands"):
        message = f"{message.rstrip('.')}; accepted: {', '.join(group.list_commands(context))}"
    return message


def printable(text: str) -> str:
    """Return a text with its control characters escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def print_error(message: str) -> None:
    """Write an error as one line, whatever is in the message."""
    try:
        print(f"Error: {printable(' '.join(message.split()))}", file=sys.stderr)
    except OSError:  # standard error is closed
        return


def _discard_stdout() -> None:
    """Discard the rest of standard output, because its reader has closed the pipe."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):
        return
