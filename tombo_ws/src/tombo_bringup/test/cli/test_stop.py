"""Ctrl-C and SIGTERM: at once. The flight is kept and readable, and all processes end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from suite_bench import names, wait_for

from in_time import in_time
from tombo_flight.process.stop_signals import Stopped, StopSignals

Start = Callable[..., "subprocess.Popen[str]"]
LONG = ("hover", "--set", "duration=300", "--set", "mission.land_time=290")


@dataclass(frozen=True)
class Process:
    """A process of a session that has not ended; zombies are left out."""

    pid: int
    cpu: int
    worker: bool


def alive_in_session(session: int) -> list[Process]:
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            python = b"python" in (entry / "cmdline").read_bytes()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            cpu = int(fields[11]) + int(fields[12])
            worker = python and int(fields[1]) == session
            found.append(Process(int(entry.name), cpu, worker))
    return found


def workers(session: int) -> list[Process]:
    return [process for process in alive_in_session(session) if process.worker]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start `tombo fly ...` in a session of its own, of which nothing is left after the test."""
    sessions: list[int] = []

    def popen(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "tombo_bringup.cli.main", "fly", *arguments],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        sessions.append(process.pid)
        return process

    yield popen
    for session in sessions:
        for process in alive_in_session(session):
            os.kill(process.pid, signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_flight_leaves_what_was_flown(start, tmp_path, number, code):
    process = start(*LONG, "-o", "out", "--json")
    wait_for(lambda: any(tmp_path.iterdir()))  # the folder is prepared, the flight begins
    time.sleep(0.1)
    os.killpg(process.pid, number)
    out, err = process.communicate(timeout=60)

    assert process.returncode == code, err
    assert err == ""
    summary = json.loads(out)
    assert summary["interrupted"]
    assert 0.0 < summary["duration_s"] < 290.0
    assert names(tmp_path) == {"out"}
    assert names(tmp_path / "out") == {"flight.mcap", "summary.json", "scenario.yaml"}
    with AnyReader([tmp_path / "out" / "flight.mcap"]) as bag:
        imu = [c for c in bag.connections if c.topic == "/imu/data_raw"]
        assert sum(c.msgcount for c in imu) == round(1000 * summary["duration_s"])
        assert sum(1 for _ in bag.messages(imu)) == round(1000 * summary["duration_s"])


@pytest.mark.real_time
def test_ctrl_c_ends_a_sweep_with_all_its_processes(start, tmp_path):
    process = start("--seeds", "0:5000", "-o", "out", "--json")
    wait_for(lambda: workers(process.pid))
    time.sleep(0.3)
    began = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)

    with in_time():
        assert time.monotonic() - began < 5.0
    assert process.returncode == 130
    assert "goes on" in err and len(err.splitlines()) == 1
    with in_time():
        wait_for(lambda: not alive_in_session(process.pid), 2.0)
    assert names(tmp_path) <= {"out"}


def test_signals_are_remembered_then_raised_and_given_back():
    before = signal.getsignal(signal.SIGINT)
    with StopSignals() as stop:
        assert not stop.requested()
        assert stop.exit_code == 0
        with stop.at_once():
            pass
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.requested()
        assert stop.exit_code == 130
        with pytest.raises(Stopped), stop.at_once():
            pytest.fail("a signal that came before counts")
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGINT) is before
