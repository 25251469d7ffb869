"""The log of a node: a file that the node writes and the supervisor reads.

The file is the node's own standard output and error, so a supervisor that is busy, stopped or gone
never holds up a node.
"""

from __future__ import annotations

import os
import re
from collections import deque
from pathlib import Path

_IMPORTANT = re.compile(r"\[(WARN|ERROR|FATAL)\]|Error: ")
_LINE = re.compile(r"\[(\w+)\] \[[\d.]+\] \[[^\]]*\]: (.*)")
_LAST_LOG_LINES = 8
_MOST_SHOWN = 10
"""Warnings and errors that are shown at a time: the file has all."""


def without_stamp(line: str) -> str:
    """Return a line of a ROS log as level and text, without node name and time."""
    match = _LINE.fullmatch(line)
    return line if match is None else f"{match[1]} {match[2]}"


class NodeLog:
    """The log of one node, at `path`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._place = 0
        self._rest = b""
        self._last: deque[str] = deque(maxlen=_LAST_LOG_LINES)

    def open(self) -> int:
        """Make the file and return a descriptor for the node to write to."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
        return os.open(self.path, flags, 0o644)

    @property
    def last_log_lines(self) -> tuple[str, ...]:
        """The last lines that were read."""
        return tuple(self._last)

    def news(self) -> list[str]:
        """Read new lines; return the warnings and errors, of many the first, and their number."""
        lines = self._read()
        self._last.extend(lines)
        important = [line for line in lines if _IMPORTANT.match(line)]
        more = len(important) - _MOST_SHOWN
        return important[:_MOST_SHOWN] + ([f"... {more} more in {self.path}"] if more > 0 else [])

    def _read(self) -> list[str]:
        """Return the whole lines since the last call."""
        with self.path.open("rb") as file:
            file.seek(self._place)
            data = file.read()
            self._place = file.tell()
        *whole, self._rest = (self._rest + data).split(b"\n")
        lines = (line.decode("utf-8", "replace").rstrip() for line in whole)
        return [line for line in lines if line]
