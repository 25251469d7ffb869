"""The log of a node: a file that the node writes and the supervisor reads.

The file is the node's own standard output and error, so a supervisor that is busy, stopped or gone
never holds up a node.
"""

from __future__ import annotations

import os
import re
import shutil
from collections import deque
from pathlib import Path

_IMPORTANT = re.compile(r"\[(WARN|ERROR|FATAL)\]|Error: ")
_LINE = re.compile(r"\[(\w+)\] \[[\d.]+\] \[[^\]]*\]: (.*)")
_AT_ONCE = 1 << 18
_LARGEST = 32 << 20
_LAST_LOG_LINES = 8
_BURST = 10
_REFILL_HZ = 1.0


def without_stamp(line: str) -> str:
    """Return a line of a ROS log as level and text, without node name and time."""
    found = _LINE.fullmatch(line)
    return line if found is None else f"{found[1]} {found[2]}"


class NodeLog:
    """The log of one node: `path`, and `path` + `.1` with what came before."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._place = 0
        self._rest = b""
        self._last: deque[str] = deque(maxlen=_LAST_LOG_LINES)
        self._tokens = float(_BURST)
        self._asked_s: float | None = None
        self._held_back = 0

    def open(self) -> int:
        """Make the file and return a descriptor for the node to write to."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
        return os.open(self.path, flags, 0o644)

    @property
    def last_log_lines(self) -> tuple[str, ...]:
        """The last lines that were read."""
        return tuple(self._last)

    def news(self, now_s: float) -> list[str]:
        """Read new lines, and return the warnings and errors.

        Of a node that complains without end only some are returned, and how many were not.

        Args:
            now_s: any clock that goes on.
        """
        self._refill(now_s)
        shown: list[str] = []
        for line in self._read():
            self._last.append(line)
            if not _IMPORTANT.match(line):
                continue
            if self._tokens >= 1.0:
                self._tokens -= 1.0
                if self._held_back:
                    shown.append(f"... {self._held_back} more in {self.path}")
                    self._held_back = 0
                shown.append(line)
            else:
                self._held_back += 1
        return shown

    def _refill(self, now_s: float) -> None:
        if self._asked_s is not None:
            self._tokens = min(_BURST, self._tokens + _REFILL_HZ * (now_s - self._asked_s))
        self._asked_s = now_s

    def _read(self) -> list[str]:
        """Return the whole lines since the last call; of a flood only the newest."""
        try:
            size = self.path.stat().st_size
            if size < self._place:
                self._place, self._rest = 0, b""
            if size - self._place > _AT_ONCE:
                self._place, self._rest = size - _AT_ONCE, b""
            with self.path.open("rb") as file:
                file.seek(self._place)
                data = file.read(_AT_ONCE)
                self._place = file.tell()
        except OSError:  # the file was removed
            return []
        if size > _LARGEST:
            self._begin_again()
        *whole, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-_AT_ONCE:]
        lines = (line.decode("utf-8", "replace").rstrip() for line in whole)
        return [line for line in lines if line]

    def _begin_again(self) -> None:
        """Put the file aside, by copying: the node goes on writing to the same one."""
        try:
            shutil.copyfile(self.path, self.path.with_name(f"{self.path.name}.1"))
            os.truncate(self.path, 0)
            self._place = 0
        except OSError:  # the disk is full: nothing is lost by going on
            return
