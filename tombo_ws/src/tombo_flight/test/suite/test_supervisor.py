"""The supervisor: it sees every end, and nothing outlives it, however it ends itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from suite_bench import FAKES, Marked, wait_for

from in_time import in_time
from tombo_flight.suite.supervisor import ProcessExit, Program, Supervisor

pytestmark = pytest.mark.slow


def fake(name: str, *, capture_stdout: bool = False) -> Program:
    return Program(name, (sys.executable, str(FAKES / f"fake_{name}.py")), capture_stdout)


def code(name: str, text: str) -> Program:
    return Program(name, (sys.executable, "-c", text))


def look_until_ended(supervisor: Supervisor, number: int = 1) -> list[ProcessExit]:
    ended: list[ProcessExit] = []

    def all_ended() -> bool:
        ended.extend(supervisor.poll(0.05).ended)
        return len(ended) >= number

    wait_for(all_ended)
    return ended


def ready(path: Path) -> bool:
    return path.exists() and path.stat().st_size > 0


@pytest.fixture
def supervise(marked: Marked, tmp_path):
    """Supervise programs; their logs are in the test's folder."""
    return lambda *programs: Supervisor(programs, tmp_path, marked.environment)


def test_a_node_that_fails_at_its_start_is_reported_with_its_words(supervise):
    with supervise(fake("broken"), fake("good")) as supervisor:
        (end,) = look_until_ended(supervisor)
        assert set(supervisor.running) == {"good"}

    assert (end.name, end.code, end.exit_text) == ("broken", 1, "exit code 1")
    assert end.last_log_lines[-1].startswith("Error: parameter detector.threshold")


def test_a_node_that_dies_later_is_reported_with_its_traceback(supervise, tmp_path):
    with supervise(fake("short"), fake("good")) as supervisor:
        (end,) = look_until_ended(supervisor)
        time.sleep(0.2)
        assert supervisor.poll(0.0).ended == []
        assert set(supervisor.running) == {"good"}

    assert end.last_log_lines[-1] == "RuntimeError: a bug"
    assert "RuntimeError: a bug" in (tmp_path / "short.log").read_text()


@pytest.mark.real_time
def test_who_obeys_is_asked_once_and_ends_at_once(supervise, tmp_path):
    counting = (
        "import signal, time\n"
        "signal.signal(signal.SIGINT, lambda n, f: (print('asked', flush=True), exit(0)))\n"
        "print('ready', flush=True)\n"
        "time.sleep(60)\n"
    )
    with supervise(code("node", counting)) as supervisor:
        wait_for(lambda: ready(tmp_path / "node.log"))
        began = time.monotonic()
        (end,) = supervisor.stop()

    with in_time():  # before SIGTERM
        assert time.monotonic() - began < 1.9
    assert end.code == 0
    assert (tmp_path / "node.log").read_text() == "ready\nasked\n"


def test_who_ends_last_is_asked_when_the_others_have_ended(supervise, tmp_path):
    def obeys_late(name: str, late_s: float) -> str:
        return (
            "import pathlib, signal, time\n"
            "signal.signal(signal.SIGINT, lambda n, f: (\n"
            f"    time.sleep({late_s}), print('others', others(), flush=True), exit(0)))\n"
            f"others = lambda: 'others' in pathlib.Path({str(tmp_path / name)!r}).read_text()\n"
            "print('ready', flush=True)\n"
            "time.sleep(60)\n"
        )

    recorder = Program("last", code("last", obeys_late("node.log", 0.0)).command, ends_last=True)
    with supervise(recorder, code("node", obeys_late("last.log", 0.3))) as supervisor:
        for name in ("last", "node"):
            wait_for(lambda name=name: ready(tmp_path / f"{name}.log"))
        assert {end.name: end.code for end in supervisor.stop()} == {"last": 0, "node": 0}
    assert (tmp_path / "node.log").read_text() == "ready\nothers False\n"
    assert (tmp_path / "last.log").read_text() == "ready\nothers True\n"


@pytest.mark.real_time
def test_a_process_that_ignores_signals_is_killed_within_three_seconds(supervise, marked):
    with supervise(fake("deaf"), fake("good")) as supervisor:
        wait_for(lambda: len(marked.alive()) >= 3)  # good, deaf and its child
        time.sleep(0.3)
        began = time.monotonic()
        ends = {end.name: end.code for end in supervisor.stop()}
        with in_time():
            assert time.monotonic() - began < 3.0

    assert ends == {"deaf": -9, "good": 0}
    assert marked.alive() == []


def test_what_a_node_leaves_behind_ends_with_it(supervise, marked):
    leaving = "import os, time\nif os.fork() == 0:\n    time.sleep(60)\n"
    with supervise(code("node", leaving)) as supervisor:
        look_until_ended(supervisor)
        wait_for(lambda: not marked.alive())


def test_an_exception_inside_ends_all_nodes(supervise, marked):
    with pytest.raises(ZeroDivisionError), supervise(fake("good")):
        raise ZeroDivisionError
    assert marked.alive() == []


@pytest.mark.real_time
def test_a_second_stop_request_kills_at_once(supervise, marked):
    supervisor = supervise(fake("deaf"))
    with pytest.raises(KeyboardInterrupt), supervisor:
        wait_for(lambda: len(marked.alive()) >= 2)
        time.sleep(0.3)
        began = time.monotonic()

        def interrupt(number: int, frame: object) -> None:
            raise KeyboardInterrupt

        before = signal.signal(signal.SIGALRM, interrupt)
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.2)
            supervisor.stop()
        finally:
            signal.signal(signal.SIGALRM, before)

    with in_time():
        assert time.monotonic() - began < 1.5
    assert marked.alive() == []


SUPERVISED = """
import os, sys
from pathlib import Path
from tombo_flight.suite.supervisor import Program, Supervisor
names = {names!r}
programs = [Program(n, (sys.executable, {fakes!r} + f"/fake_{{n}}.py")) for n in names]
with Supervisor(programs, Path({logs!r}), os.environ) as supervisor:
    print(*supervisor.running.values(), flush=True)
    while True:
        supervisor.poll(0.1)
"""


@pytest.fixture
def supervised(marked: Marked, tmp_path):
    """Start a supervisor in a process of its own, to be killed."""

    def start(*names: str) -> subprocess.Popen[str]:
        logs = tmp_path / "log"
        process = marked.python(SUPERVISED.format(names=names, fakes=str(FAKES), logs=str(logs)))
        wait_for(lambda: ready(logs / "good.log"))
        return process

    return start


def killed(process: subprocess.Popen[str], marked: Marked, limit_s: float) -> None:
    """Kill a supervisor: all that it has started ends in time."""
    process.kill()
    process.communicate()
    took = wait_for(lambda: not marked.alive())
    with in_time():
        assert took < limit_s


@pytest.mark.real_time
def test_nothing_outlives_a_supervisor_that_is_killed(marked: Marked, supervised):
    process = supervised("good", "deaf")
    wait_for(lambda: len(marked.alive()) >= 5)  # supervisor, guard, good, deaf and its child
    time.sleep(0.3)
    killed(process, marked, 3.0)


@pytest.mark.real_time
def test_who_obeys_ends_well_when_the_supervisor_is_killed(marked: Marked, supervised):
    """A recorder can close its file: it is asked, not killed."""
    killed(supervised("good"), marked, 1.5)


@pytest.mark.real_time
def test_a_guard_that_is_killed_changes_nothing_for_who_obeys(marked: Marked, supervised):
    process = supervised("good")
    (guard,) = (
        p for p in marked.alive() if b"guard.py" in Path(f"/proc/{p}/cmdline").read_bytes()
    )
    os.kill(guard, signal.SIGKILL)
    killed(process, marked, 1.5)


def test_words_on_a_pipe_come_whole_line_by_line(supervise):
    halves = (
        "import sys, time\n"
        "for half in ('{\"a\":', ' 1}\\n', 'x\\ny\\n'):\n"
        "    sys.stdout.write(half); sys.stdout.flush(); time.sleep(0.2)\n"
        "time.sleep(60)\n"
    )
    program = Program("node", (sys.executable, "-c", halves), capture_stdout=True)
    heard: list[tuple[str, str]] = []
    with supervise(program) as supervisor:
        wait_for(lambda: heard.extend(supervisor.poll(0.05).lines) or len(heard) >= 3)

    assert heard == [("node", '{"a": 1}'), ("node", "x"), ("node", "y")]
