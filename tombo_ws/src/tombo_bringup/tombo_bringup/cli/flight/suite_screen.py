"""Output of `tombo up`: lines of text, on a terminal above a live table; or JSON lines."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, Final

from rich.live import Live
from rich.text import Text

from tombo_bringup.cli.errors import printable
from tombo_bringup.cli.tables import console

if TYPE_CHECKING:
    from tombo_flight.suite.status_table import SuiteState
    from tombo_flight.suite.supervisor import ProcessExit

_PRINTED_S: Final = 5.0
_DRAWN_S: Final = 0.25


class Screen:
    """Shows what happens to a suite: text above a table, or a JSON object a line, by its event."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._due_s = time.monotonic()
        self._live: Live | None = None
        if sys.stdout.isatty() and not as_json:
            self._live = Live(console=console(), auto_refresh=False, redirect_stderr=False)

    def shown(self) -> AbstractContextManager[object]:
        """Return the context in which the table is drawn."""
        return self._live or nullcontext()

    def status(self, suite: SuiteState) -> None:
        """Print the status now and then, or draw the table; called often."""
        from tombo_flight.suite.status_table import status_line, status_object, status_table

        if time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + (_DRAWN_S if self._live else _PRINTED_S)
        if self._live is not None:
            self._live.update(status_table(suite), refresh=True)
        else:
            self._put(status_object(suite), status_line(suite))

    def warning(self, node: str, line: str) -> None:
        """Print a line of a node's log."""
        from tombo_flight.suite.supervisor import without_stamp

        event = {"event": "warning", "node": node, "text": line}
        self._put(event, f"{node}: {without_stamp(line)}")

    def notice(self, text: str) -> None:
        """Print it."""
        self._put({"event": "notice", "text": text}, text)

    def answer(self, answer: Mapping[str, Any]) -> None:
        """Print what the nodes said to a request."""
        done = "" if answer["success"] else " refused"
        self._put({"event": "answer", **answer}, f"{answer['request']}{done}: {answer['message']}")

    def ended(self, end: ProcessExit, log: str) -> None:
        """Print that a node has ended by itself, with the last lines of its log."""
        words = "".join(f"\n  {line}" for line in end.last_log_lines)
        text = f"{end.name} has ended, {end.exit_text}; its log: {log}{words}"
        self._put({"event": "ended", **_plain(end), "log": log}, text)

    def closing(self, ends: Sequence[ProcessExit], folder: str) -> None:
        """Print nodes that did not end as asked, and the folder of the files."""
        lines = [f"{e.name} did not stop when asked to: {e.exit_text}" for e in ends]
        event = {"event": "closed", "folder": folder, "not_well": [_plain(e) for e in ends]}
        self._put(event, "\n".join([*lines, f"stopped; files in {folder}"]))

    def _put(self, event: Mapping[str, Any], text: str) -> None:
        from tombo_flight.json_text import plain

        if self._as_json:
            print(json.dumps(plain(event), ensure_ascii=False), flush=True)
            return
        for line in map(printable, text.split("\n")):
            if self._live is not None:
                self._live.console.print(Text(line))
            else:
                print(line, flush=True)


def _plain(end: ProcessExit) -> dict[str, Any]:
    return {
        "node": end.name,
        "exit_code": end.code,
        "how": end.exit_text,
        "last_words": list(end.last_log_lines),
    }
