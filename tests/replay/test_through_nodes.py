"""A replay over DDS: the real detector, played to and listened to; all processes end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from in_time import in_time
from tombo_dynamics.errors import InputError
from tombo_flight.replay.run import ReplayRequest, replay_bag
from tombo_flight.replay.through_nodes import ThroughNodes

pytestmark = pytest.mark.slow

BAG = Path(__file__).parents[2] / "tests" / "bags" / "paper_collision_7.mcap"


def processes(word: str) -> set[int]:
    found = set()
    for entry in Path("/proc").iterdir():
        try:
            if word in (entry / "cmdline").read_text() and entry.name != str(os.getpid()):
                found.add(int(entry.name))
        except (OSError, ValueError):
            continue
    return found


@pytest.mark.real_time
def test_the_real_detector_says_what_was_recorded():
    result = replay_bag(BAG, ReplayRequest(nodes=("detector",)), ThroughNodes(60.0))
    metrics = result.nodes["detector"]
    assert (metrics["matched"], metrics["missed"], metrics["extra"]) == (1, 0, 0)
    assert metrics["detection_time_difference_ms"] == [0.0]
    assert metrics["x_c_error_m"][0] < 1e-9
    assert metrics["dds"]["sent"] == 1198
    assert metrics["dds"]["received"] >= 1190
    with in_time():
        assert -5.0 < metrics["known_time_difference_ms"][0] < 100.0
    assert len(result.replayed.series["statistic"].stamp_ns) >= 1190
    assert not processes("/tombo-replay-")


def test_a_node_that_will_not_start_is_named_with_its_last_words(monkeypatch):
    from tombo_flight.suite import nodes

    monkeypatch.setitem(nodes.SUITE, "detector", "tombo_collision.no_such_node")
    with pytest.raises(InputError, match=r"detector ended before the replay did .*no_such_node"):
        replay_bag(BAG, ReplayRequest(nodes=("detector",)), ThroughNodes(60.0))
    assert not processes("/tombo-replay-")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_everything(tmp_path, number):
    command = ["-m", "tombo_bringup.cli.main", "replay", str(BAG), "--node", "detector", "--dds"]
    process = subprocess.Popen(
        [sys.executable, *command],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        text=True,
    )
    try:
        end = time.monotonic() + 60.0
        while not processes(str(tmp_path)) and time.monotonic() < end:
            time.sleep(0.05)
        time.sleep(0.3)
        process.send_signal(number)
        out, err = process.communicate(timeout=60.0)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 128 + number
    assert (out, err) == ("", "Error: interrupted\n")
    assert not processes(str(tmp_path))
    assert list(tmp_path.iterdir()) == []
