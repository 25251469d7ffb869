"""`tombo up` with fake nodes: its screen, its end, its files."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from suite_bench import UP, Marked, read_terminal, wait_for

from in_time import in_time
from tombo_flight.suite.nodes import local_discovery

GOOD = {"sim": "fake_good", "detector": "fake_good"}


def log(marked: Marked, node: str) -> Path:
    return marked.folder / "out" / "log" / f"{node}.log"


def started(marked: Marked, *nodes: str) -> None:
    wait_for(lambda: all(log(marked, node).exists() for node in nodes))
    wait_for(lambda: all("running" in log(marked, node).read_text() for node in nodes))


def read_until(process: subprocess.Popen[str], enough: Callable[[list[str]], bool]) -> list[str]:
    """Lines of the command until they are enough."""
    lines: list[str] = []
    assert process.stdout is not None
    while not enough(lines):
        line = process.stdout.readline()
        assert line, f"it ended after {lines}"
        lines.append(line.rstrip("\n"))
    return lines


@pytest.mark.real_time
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_user_stops_it_with_exit_code_0_and_nothing_is_left(marked, number):
    process = marked.up(GOOD)
    started(marked, *GOOD)
    os.kill(process.pid, number)
    if number == signal.SIGHUP:  # a terminal that closes says it more than once
        time.sleep(0.05)
        os.kill(process.pid, number)
    took = wait_for(lambda: set(marked.alive()) <= {process.pid})
    out, err = process.communicate(timeout=60)

    with in_time():
        assert took < 3.0
    assert process.returncode == 0, err
    assert err == ""
    assert out.splitlines()[-1] == "stopped; files in out"
    assert marked.alive() == []


@pytest.mark.slow
def test_a_dead_node_is_reported_with_its_last_output_others_go_on(marked):
    process = marked.up({"sim": "fake_good", "mission": "fake_short"})
    started(marked, "sim")
    lines = read_until(process, lambda lines: "  RuntimeError: a bug" in lines)
    lines += read_until(process, lambda lines: any("1 of 2 nodes run" in line for line in lines))
    os.kill(process.pid, signal.SIGINT)
    rest, err = process.communicate(timeout=60)

    assert process.returncode == 1
    assert err == ""
    assert "mission: WARN odometry_silent: no odometry" in lines
    assert "mission has ended, exit code 1; its log: out/log/mission.log" in lines
    assert not any("sim has ended" in line for line in [*lines, rest])


@pytest.mark.slow
def test_json_lines_have_status_and_ends(marked):
    suite = {"sim": "fake_good", "mission": "fake_short", "detector": "fake_deaf"}
    process = marked.up(suite, "--json")
    started(marked, "sim")

    def all_told(lines: list[str]) -> bool:
        last = json.loads(lines[-1]) if lines else {}
        return '"exit code 1"' in str(lines) and "loop" in last.get("nodes", {}).get(
            "sim", {}
        ).get("loops", {})

    lines = read_until(process, all_told)
    os.kill(process.pid, signal.SIGTERM)
    rest, err = process.communicate(timeout=60)
    events = [json.loads(line) for line in [*lines, *rest.splitlines()]]

    assert process.returncode == 1, err
    by_kind = {kind: [e for e in events if e["event"] == kind] for kind in (
        "status", "warning", "ended", "closed")}  # fmt: skip
    assert json.loads(lines[-1])["phase"] == "hover"
    assert json.loads(lines[-1])["height_m"] == 2.014
    nodes = json.loads(lines[-1])["nodes"]
    assert nodes["sim"]["state"] == "running"
    assert nodes["sim"]["loops"]["loop"] == {
        "rate_hz": 999.5, "jitter_p50_us": 3.0, "jitter_p99_us": 41.0, "missed": 7
    }  # fmt: skip
    assert nodes["detector"]["faults"] == "mocap_silent: no pose for 1 s"
    assert (nodes["mission"]["state"], nodes["mission"]["exit_code"]) == ("exit code 1", 1)
    assert [(e["node"], e["exit_code"]) for e in by_kind["ended"]] == [("mission", 1)]
    assert [e["node"] for e in by_kind["closed"][0]["not_well"]] == ["detector"]
    assert marked.alive() == []


@pytest.mark.slow
def test_nodes_get_parameters_domain_and_discovery(marked):
    tell = marked.folder / "tell.py"
    tell.write_text(
        "import os, sys, time\n"
        "print(sys.argv[1:], {k: os.environ[k] for k in os.environ if k[:3] in ('ROS', 'FAS')})\n"
        "print('running', flush=True)\ntime.sleep(60)\n"
    )
    words = ("--domain", "42", "--set", "detector.threshold=81")
    process = marked.up({"detector": "tell"}, *words)
    started(marked, "detector")
    os.kill(process.pid, signal.SIGINT)
    process.communicate(timeout=60)
    said = log(marked, "detector").read_text()

    own = marked.folder / "out" / "parameters.yaml"
    assert str(["--ros-args", "--params-file", str(own)]) in said
    assert "'ROS_DOMAIN_ID': '42'" in said
    discovery = local_discovery(os.environ)
    assert all(f"'{name}': '{value}'" in said for name, value in discovery.items())
    written = yaml.safe_load(own.read_text())
    assert written["/**/detector"]["ros__parameters"]["detector"]["threshold"] == 81.0


@pytest.mark.slow
def test_keys_ask_the_mission_and_a_kill_takes_two_strokes(marked):
    code = UP.format(suite=GOOD, monitor="fake_monitor")
    pid, terminal = pty.fork()  # keys are read from the terminal that controls the process
    if pid == 0:
        os.chdir(marked.folder)
        environment = {**marked.environment, "COLUMNS": "160", "TERM": "xterm"}
        words = [sys.executable, "-c", code, "up", "hover", "-o", "out"]
        os.execve(sys.executable, words, environment)
    text = ""

    def shown(*parts: str) -> None:
        nonlocal text
        end = time.monotonic() + 60.0
        while not all(part in text for part in parts):
            assert time.monotonic() < end, f"{parts} not in {text}"
            text += os.read(terminal, 65536).decode("utf-8", "replace")

    shown("keys: h hold, l land, kk kill", "hover at 2.01 m")
    os.write(terminal, b"hx")
    shown("hold: asked to hold")
    os.write(terminal, b"l")
    shown("land refused: asked to land")
    os.write(terminal, b"k")
    shown("kill: once more within a second")
    assert "asked to kill" not in text
    time.sleep(1.1)
    os.write(terminal, b"kk")
    shown("kill: asked to kill")
    os.write(terminal, b"\x03")
    shown("stopped; files in out")
    read_terminal(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
