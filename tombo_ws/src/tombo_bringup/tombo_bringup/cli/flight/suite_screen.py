"""Output of `tombo up`: lines, on a terminal the status below them; or JSON lines."""

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
def new_screen(as_json: bool) -> Iterator[Screen]:
    """Make the screen that fits where standard output leads to."""
    if as_json:
        yield Screen(Scroll(None), as_json=True)
        return
    with scroll() as lines:
        yield Screen(lines)


class Screen:
    """Lines of text; or a JSON object a line, by its event."""

    def __init__(self, scroll: Scroll, *, as_json: bool = False) -> None:
        self._scroll = scroll
        self._as_json = as_json

    def status(self, suite: SuiteState) -> None:
        """Show the status now and then; called often."""
        from tombo_flight.suite.status_table import status_line, status_object

        if not self._scroll.due():
            return
        if self._as_json:
            self._put(status_object(suite), "")
        else:
            self._scroll.show(status_line(suite))

    def warning(self, node: str, line: str) -> None:
        """Print a line of a node's log."""
        from tombo_flight.suite.node_log import without_stamp

        event = {"event": "warning", "node": node, "text": line}
        self._put(event, f"{node}: {without_stamp(line)}", "yellow")

    def notice(self, text: str) -> None:
        """Print it."""
        self._put({"event": "notice", "text": text}, text, "bold")

    def answer(self, answer: Mapping[str, Any]) -> None:
        """Print what the nodes said to a request."""
        done, style = ("", "bold") if answer["success"] else (" refused", "bold red")
        text = f"{answer['request']}{done}: {answer['message']}"
        self._put({"event": "answer", **answer}, text, style)

    def ended(self, end: ProcessExit, log: str) -> None:
        """Print that a node has ended by itself, with the last lines of its log."""
        words = "".join(f"\n  {line}" for line in end.last_log_lines)
        text = f"{end.name} has ended, {end.exit_text}; its log: {log}{words}"
        self._put({"event": "ended", **_plain(end), "log": log}, text, "bold red")

    def closing(self, ends: Sequence[ProcessExit], folder: str) -> None:
        """Print nodes that did not end as asked, and the folder of the files."""
        lines = [f"{e.name} did not stop when asked to: {e.exit_text}" for e in ends]
        event = {"event": "closed", "folder": folder, "not_well": [_plain(e) for e in ends]}
        self._put(event, "\n".join([*lines, f"stopped; files in {folder}"]))

    def _put(self, event: Mapping[str, Any], text: str, style: str = "") -> None:
        from tombo_flight.json_text import plain

        if self._as_json:
            print(json.dumps(plain(event), ensure_ascii=False), flush=True)
            return
        for line in text.split("\n"):
            self._scroll.put(line, style)


def _plain(end: ProcessExit) -> dict[str, Any]:
    return {
        "node": end.name,
        "exit_code": end.code,
        "how": end.exit_text,
        "last_words": list(end.last_log_lines),
    }
