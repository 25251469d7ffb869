"""Fake nodes in place of the suite's, and a look at which processes a test has left."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

FAKES = Path(__file__).parent / "fakes"
MARK = "TOMBO_TEST_MARK"

UP = """
import sys
from types import ModuleType
sys.modules["tombo_flight.run_wiring"] = warm_up = ModuleType("warm_up")
warm_up.warm_up_nodes = lambda scenario: None  # nothing flies: saves a second
from tombo_flight.suite import nodes
nodes.SUITE.clear()
nodes.SUITE.update({suite!r})
nodes.MONITOR_MODULE = {monitor!r}
from tombo_bringup.cli.flight import suite_screen
suite_screen._PRINTED_S = 1.5
from tombo_bringup.cli.main import run
run(sys.argv[1:])
"""


class Marked:
    """Processes that carry a mark in their environment, with all that they start."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.mark = f"{MARK}={folder}"

    @property
    def environment(self) -> dict[str, str]:
        paths = [str(FAKES), *filter(None, [os.environ.get("PYTHONPATH")])]
        return {
            **os.environ,
            MARK: str(self.folder),
            "PYTHONPATH": os.pathsep.join(paths),
            "ROS_DOMAIN_ID": "77",
        }

    def python(self, code: str, *arguments: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def up(
        self, suite: dict[str, str], *arguments: str, monitor: str = "fake_monitor"
    ) -> subprocess.Popen[str]:
        """`tombo up hover ...` with the nodes of `suite` (name → module)."""
        code = UP.format(suite=suite, monitor=monitor)
        return self.python(code, "up", "hover", "-o", "out", *arguments)

    def alive(self) -> list[int]:
        """Processes that have not ended; zombies are left out."""
        found = []
        for entry in Path("/proc").iterdir():
            try:
                if not entry.name.isdigit():
                    continue
                zombie = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
                if not zombie and self.mark.encode() in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
            except OSError:
                continue
        return sorted(found)

    def end_all(self) -> None:
        for pid in self.alive():
            os.kill(pid, signal.SIGKILL)


@pytest.fixture
def marked(tmp_path: Path) -> Iterator[Marked]:
    """Processes that a test starts, and none of them after it."""
    processes = Marked(tmp_path)
    yield processes
    processes.end_all()


def names(folder: Path) -> set[str]:
    """The names of the files of a folder."""
    return {path.name for path in folder.iterdir()}


def read_terminal(ours: int) -> bytes:
    """Output on a pseudo terminal until its other side is closed; closes this side."""
    shown = b""
    with contextlib.suppress(OSError):  # the other side is closed
        while data := os.read(ours, 65536):
            shown += data
    os.close(ours)
    return shown


def wait_for(condition: Callable[[], object], limit_s: float = 60.0) -> float:
    """Wait, and return how long it took [s]."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < limit_s, "waited too long"
        time.sleep(0.01)
    return time.monotonic() - began
