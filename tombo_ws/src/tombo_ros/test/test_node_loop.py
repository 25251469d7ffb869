"""A node is one loop: its rate, its clock, its end, and its message when it can't begin."""

from __future__ import annotations

import signal
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

import tiny_node
from rosgraph_msgs.msg import Clock
from tiny_node import ECHO, POKE, STEPS

from in_time import in_time
from tombo_bag.topics import CLOCK
from tombo_ros.conversion import to_ns, to_time

_MS = 1_000_000


@pytest.fixture(autouse=True)
def _tiny_node_is_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    here = str(Path(tiny_node.__file__).parent)
    known = os.environ.get("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", f"{here}:{known}" if known else here)


def _steps(world: Any) -> list[int]:
    world.hear()
    return [to_ns(message.clock) for message in world.heard[STEPS.name]]


def _settle(world: Any, condition: Any, patience_s: float = 60.0) -> None:
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_with_simulated_time_it_runs_when_the_clock_says_so(world: Any, start: Any) -> None:
    world.subscribe(STEPS, ECHO)
    node = start("tiny_node", "-p", "use_sim_time:=true")
    world.meet(CLOCK, POKE, STEPS, ECHO)
    _settle(world, lambda: "running" in node.output)
    time.sleep(0.3)
    world.publish(POKE, Clock())
    time.sleep(0.2)
    assert _steps(world) == []  # no clock, no run, whatever is heard

    def ran() -> bool:
        world.tick(0)  # the same time again, where the message before was lost
        return (_steps(world) or [0])[-1] > world.now_ns - 10 * _MS

    for _ in range(100):  # a second at 2 ms: 100 Hz are 100 runs
        for _ in range(5):
            world.tick(2 * _MS)
        _settle(world, ran)
    steps = _steps(world)
    _settle(world, lambda: _steps(world) is not None and world.heard[ECHO.name])
    poked = len(world.heard[ECHO.name])
    assert poked == 1  # it was kept until time began
    assert 97 <= len(steps) <= 103
    assert all(a < b for a, b in pairwise(steps))
    assert steps[0] <= 1_000 * _MS + 20 * _MS
    assert steps[-1] >= 2_000 * _MS - 20 * _MS

    before = len(steps)
    time.sleep(0.3)
    assert len(_steps(world)) == before  # the clock stands still

    world.publish(POKE, Clock(clock=to_time(77)))  # a message does not wait for the clock
    world.wait_for(ECHO, lambda message: to_ns(message.clock) == 77)
    assert _steps(world)[-1] == world.now_ns

    world.tick(-1_500 * _MS)  # set back: it goes on from there
    _settle(world, lambda: _steps(world)[-1] == world.now_ns)
    assert node.end() == 0


@pytest.mark.real_time
def test_in_real_time_it_keeps_its_rate_and_leaves_the_graph_when_told(
    world: Any, start: Any
) -> None:
    world.subscribe(STEPS)
    node = start("tiny_node")
    world.meet(STEPS)
    _settle(world, lambda: len(_steps(world)) > 20)
    since = len(_steps(world))
    began = time.time_ns()
    time.sleep(1.5)
    steps = _steps(world)[since:]
    spent = (time.time_ns() - began) * 1e-9
    with in_time():
        assert len(steps) == pytest.approx(100.0 * spent, rel=0.25)
    assert all(0 <= began_ns - steps[0] < 10**10 for began_ns in steps)

    told = time.monotonic()
    node.process.send_signal(signal.SIGINT)
    node.process.send_signal(signal.SIGTERM)
    node.process.send_signal(signal.SIGINT)
    assert node.process.wait(60.0) == 0
    _settle(world, lambda: not world.node.count_publishers(STEPS.name))
    with in_time():
        assert time.monotonic() < told + 3.0
    assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("-p", "estimator.jump_min:=1e9"), "estimator.jump_min"),
        (("-p", "estimator.jump_min:=[1, x]"), "jump_min"),
        (("-p", "nonsense"), "nonsense"),
        (("--params-file", "/no/such/file.yaml"), "/no/such/file.yaml"),
        (("--params-file", "broken.yaml"), "broken.yaml"),
        (("-r", "__node:=not a name"), "not a name"),
    ],
)
def test_what_cannot_begin_says_why_in_one_line(
    start: Any, tmp_path: Path, arguments: tuple[str, ...], named: str
) -> None:
    (tmp_path / "broken.yaml").write_text("tiny:\n  ros__parameters: [\n")
    given = [str(tmp_path / a) if a == "broken.yaml" else a for a in arguments]
    node = start("tiny_node", *given)
    assert node.process.wait(60.0) == 2
    lines = [line for line in node.output.splitlines() if "[rcl]" not in line]  # rcl's own
    assert len(lines) == 1, lines
    assert lines[0].startswith("Error: ")
    assert named in lines[0]
