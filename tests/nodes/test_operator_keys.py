"""The keys of `tombo up`, pressed in flight while every node that may be dead is dead."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import pytest

from ros_bench import die_with_the_test
from tombo_bag.topics import PX4_STATUS, ROTOR_COMMAND, TRUE_ODOMETRY

pytestmark = pytest.mark.real_time

pytest.importorskip("rclpy")
PATIENCE_S = 120.0
HELPERS = ("mission", "reaction", "detector", "recorder")
FLIES_ON = ("--set", "mission.land_time=3000")
SLOW = ("--speed", "0.4")
"""Without PX4, simulated time: a busy machine flies too."""


class Terminal:
    """`tombo up --json` in a terminal of its own."""

    def __init__(self, ours):
        self._ours, self._text = ours, ""
        self.lines = []

    def press(self, keys):
        os.write(self._ours, keys.encode())

    def wait(self, condition):
        """Return the first line from now on that meets a condition."""
        since, end = len(self.lines), time.monotonic() + PATIENCE_S
        while True:
            for line in self.lines[since:]:
                if condition(line):
                    return line
            since = len(self.lines)
            assert time.monotonic() < end, self.lines[-3:]
            with suppress(OSError):
                self._text += os.read(self._ours, 65536).decode("utf-8", "replace")
            *whole, self._text = self._text.split("\n")
            self.lines += [json.loads(line) for line in whole if line.startswith("{")]

    def answer(self, request):
        return self.wait(lambda e: e["event"] == "answer" and e["request"] == request)

    def kill(self, names):
        """Kill nodes, and wait until they have ended."""
        nodes = self.wait(lambda e: e["event"] == "status")["nodes"]
        for name in names:
            os.kill(nodes[name]["pid"], signal.SIGKILL)
        left = set(names)
        while left:
            left.discard(self.wait(lambda e: e["event"] == "ended")["node"])


@contextmanager
def up(folder, *arguments):
    ours, theirs = pty.openpty()
    words = ["up", "hover", *FLIES_ON, "-o", str(folder / "up"), "--json", *arguments]
    code = "import os, fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    code += "from tombo_bringup.cli.main import run; import sys; run(sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdin=theirs, stdout=theirs, stderr=theirs,
        start_new_session=True, preexec_fn=die_with_the_test,
    )  # fmt: skip
    os.close(theirs)
    try:
        yield Terminal(ours)
    finally:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(30.0)
        process.kill()
        process.wait()
        os.close(ours)


def flies(world, terminal, dead):
    """Wait until it hovers, and let nodes die."""
    world.subscribe(TRUE_ODOMETRY, PX4_STATUS, ROTOR_COMMAND)
    world.wait_for(TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 1.5, patience_s=PATIENCE_S)
    terminal.kill(dead)


def test_over_px4_it_holds_and_lands_with_all_others_dead(world, tmp_path):
    with up(tmp_path, "--px4") as terminal:
        flies(world, terminal, HELPERS)
        terminal.press("h")
        assert terminal.answer("hold")["success"]
        terminal.press("l")
        assert terminal.answer("land")["success"]
        world.wait_for(PX4_STATUS, lambda m: not m.armed, patience_s=PATIENCE_S)
        assert world.heard[TRUE_ODOMETRY.name][-1].pose.pose.position.z < 0.3


def test_over_px4_two_strokes_stop_the_rotors_with_all_others_dead(world, tmp_path):
    with up(tmp_path, "--px4") as terminal:
        flies(world, terminal, HELPERS)
        terminal.press("kk")
        assert terminal.answer("kill")["success"]
        world.wait_for(PX4_STATUS, lambda m: not m.armed, patience_s=PATIENCE_S)


@pytest.mark.parametrize("key", ["h", "l"])
def test_the_controller_lands_it_with_all_others_dead(world, tmp_path, key):
    with up(tmp_path, *SLOW) as terminal:
        flies(world, terminal, HELPERS)
        terminal.press(key)
        answer = terminal.answer({"h": "hold", "l": "land"}[key])
        assert answer["success"] and "controller/abort" in answer["message"], answer
        world.wait_for(ROTOR_COMMAND, lambda m: max(m.speed) == 0.0, patience_s=PATIENCE_S)
        assert world.heard[TRUE_ODOMETRY.name][-1].pose.pose.position.z < 0.3


def test_two_strokes_stop_the_rotors_with_all_but_the_controller_dead(world, tmp_path):
    with up(tmp_path, *SLOW) as terminal:
        flies(world, terminal, (*HELPERS, "estimator"))
        terminal.press("kk")
        assert terminal.answer("kill")["success"]
        world.wait_for(ROTOR_COMMAND, lambda m: max(m.speed) == 0.0, patience_s=PATIENCE_S)
