"""A `tombo` command in a terminal of its own, whose keys are pressed by a program."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

_LEADS = (
    "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0);"
    "from tombo_bringup.cli.main import run; run(sys.argv[1:])"
)
"""The terminal controls the process: keys are read from no other."""
_ENDS_S = 40.0


class Terminal:
    """Use as a context manager: leaving it ends the command.

    Attributes:
        text: output of the command.
        lines: the JSON objects in it, one on each line.
    """

    def __init__(
        self, words: Sequence[str], folder: Path, patience_s: float, preexec_fn: Any = None
    ) -> None:
        """Start `tombo` with these words in a folder.

        Args:
            words: arguments of the command.
            folder: where it runs.
            patience_s: the longest wait for a line of its output.
            preexec_fn: of `subprocess.Popen`.
        """
        self.text, self.lines = "", list[dict[str, Any]]()
        self._patience_s, self._parsed, self._seen = patience_s, 0, 0
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-c", _LEADS, *words], cwd=folder, stdin=theirs, stdout=theirs,
            stderr=theirs, start_new_session=True, preexec_fn=preexec_fn,
        )  # fmt: skip
        os.close(theirs)

    def __enter__(self) -> Terminal:
        """Return it."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the command."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.exit_code(_ENDS_S)
        os.close(self._ours)

    def press(self, keys: str) -> None:
        """Type."""
        os.write(self._ours, keys.encode())

    def exit_code(self, patience_s: float) -> int:
        """Wait for the end, and return the exit code; what does not end is killed: -9."""
        end_s = time.monotonic() + patience_s
        while self.process.poll() is None and time.monotonic() < end_s:
            self.read()
        if self.process.poll() is None:
            self.process.kill()
        return self.process.wait()

    def wait(self, condition: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Return the first JSON line that meets a condition, after the last that has met one.

        Raises:
            TimeoutError: there is none in time, or the command has ended.
        """
        end_s = time.monotonic() + self._patience_s
        while True:
            for line in self.lines[self._seen :]:
                self._seen += 1
                if condition(line):
                    return line
            if time.monotonic() > end_s or not self.read():
                raise TimeoutError(f"waited too long; it has printed {self.text[-2000:]}")

    def answer(self, request: str) -> dict[str, Any]:
        """Return the answer of `tombo up --json` to a key."""
        return self.wait(lambda e: e["event"] == "answer" and e["request"] == request)

    def read(self) -> bool:
        """Take what has been printed; False: the command has ended."""
        os.set_blocking(self._ours, False)
        data = b""
        with suppress(BlockingIOError, OSError):
            data = os.read(self._ours, 65536)
        self.text += data.decode("utf-8", "replace")
        whole = self.text.rfind("\n") + 1
        for line in self.text[self._parsed : whole].splitlines():
            with suppress(ValueError):
                said = json.loads(line)
                self.lines += [said] if isinstance(said, dict) else []
        self._parsed = max(whole, self._parsed)
        if not data:
            time.sleep(0.02)
        return bool(data) or self.process.poll() is None
