"""Output of `tombo up`: a live table on a terminal, lines elsewhere, or JSON lines."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tombo_bringup.cli.tables import Scroll, scroll

if TYPE_CHECKING:
    from tombo_flight.suite.status_table import SuiteState
    from tombo_flight.suite.supervisor import ProcessExit


@contextmanager
def new_screen(as_json: bool) -> Iterator[JsonScreen | TextScreen]:
    """Make the screen that fits where standard output leads to."""
    if as_json:
        yield JsonScreen()
        return
    with scroll() as lines:
        yield TextScreen(lines)


class JsonScreen:
    """An object a line: status, warning, ended, closed; with the methods of `TextScreen`."""

    def __init__(self) -> None:
        self._scroll = Scroll(None)

    def status(self, suite: SuiteState) -> None:
        """Print the status now and then."""
        from tombo_flight.suite.status_table import status_object

        if self._scroll.due():
            self._put(status_object(suite))

    def warning(self, node: str, line: str) -> None:
        """Print it."""
        self._put({"event": "warning", "node": node, "text": line})

    def notice(self, text: str) -> None:
        """Print it."""
        self._put({"event": "notice", "text": text})

    def answer(self, answer: Mapping[str, Any]) -> None:
        """Print it."""
        self._put({"event": "answer", **answer})

    def ended(self, end: ProcessExit, log: str) -> None:
        """Print it."""
        self._put({"event": "ended", **_plain(end), "log": log})

    def closing(self, ends: Sequence[ProcessExit], folder: str) -> None:
        """Print it."""
        self._put({"event": "closed", "folder": folder, "not_well": [_plain(e) for e in ends]})

    def _put(self, value: dict[str, Any]) -> None:
        from tombo_flight.json_text import plain

        print(json.dumps(plain(value), ensure_ascii=False), flush=True)


class TextScreen:
    """Lines of text; on a terminal a table below them."""

    def __init__(self, scroll: Scroll) -> None:
        self._scroll = scroll
        self._put = scroll.put

    def status(self, suite: SuiteState) -> None:
        """Print a line now and then, or draw the table a few times a second; called often."""
        from tombo_flight.suite.status_table import status_line, status_table

        if not self._scroll.due():
            return
        if self._scroll.live is None:
            self._put(status_line(suite))
        else:
            self._scroll.draw(status_table(suite))

    def warning(self, node: str, line: str) -> None:
        """Print a line of a node's log."""
        from tombo_flight.suite.node_log import without_stamp

        self._put(f"{node}: {without_stamp(line)}", "yellow")

    def notice(self, text: str) -> None:
        """Print it."""
        self._put(text, "bold")

    def answer(self, answer: Mapping[str, Any]) -> None:
        """Print what the nodes said to a request."""
        done = "" if answer["success"] else " refused"
        style = "bold" if answer["success"] else "bold red"
        self._put(f"{answer['request']}{done}: {answer['message']}", style)

    def ended(self, end: ProcessExit, log: str) -> None:
        """Print that a node has ended by itself, with the last lines of its log."""
        self._put(f"{end.name} has ended, {end.exit_text}; its log: {log}", "bold red")
        for line in end.last_log_lines:
            self._put(f"  {line}")

    def closing(self, ends: Sequence[ProcessExit], folder: str) -> None:
        """Print nodes that did not end as asked, and the folder of the files."""
        for end in ends:
            self._put(f"{end.name} did not stop when asked to: {end.exit_text}", "yellow")
        self._put(f"stopped; files in {folder}")


def _plain(end: ProcessExit) -> dict[str, Any]:
    return {
        "node": end.name,
        "exit_code": end.code,
        "how": end.exit_text,
        "last_words": list(end.last_log_lines),
    }
