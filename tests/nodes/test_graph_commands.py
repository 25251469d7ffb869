"""`tombo topic` and `tombo param` look at running nodes, which they first have to discover."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import pytest
import yaml

from tombo_bag.topics import DIAGNOSTICS

pytest.importorskip("rclpy")
PATIENCE_S = 300.0


def run_json(*words: str, code: int = 0, wanted: str = "") -> Any:
    """Return the JSON of a command.

    It is repeated until the exit code is the wanted one and the output has the wanted text: on a
    busy machine a node is discovered before its topics are.
    """
    command = [sys.executable, "-m", "tombo_bringup.cli.main", *words, "--json"]
    end_s = time.monotonic() + PATIENCE_S
    while True:
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        if (run.returncode == code and wanted in run.stdout) or time.monotonic() > end_s:
            break
    assert run.returncode == code, run.stderr
    return run if words[1] == "dump" else json.loads(run.stdout)


@pytest.fixture
def mission(world, start):
    world.subscribe(DIAGNOSTICS)
    start("tombo_control.mission_node")
    world.meet(DIAGNOSTICS, patience_s=PATIENCE_S)


def test_topics_are_listed_printed_and_measured(mission):
    topics = run_json("topic", "list", wanted=DIAGNOSTICS.name)
    assert topics[DIAGNOSTICS.name] == DIAGNOSTICS.typename
    (status, *_) = run_json("topic", "echo", DIAGNOSTICS.name, "-n", "1")["status"]
    assert status["name"] == "mission"
    measured = run_json("topic", "hz", DIAGNOSTICS.name, "--seconds", "3")
    assert measured["messages"] > 0 and measured["rate_hz"] >= 0.0


def test_parameters_are_set_refused_and_written(mission):
    name = "mission.height"
    assert run_json("param", "set", "mission", name, "1.7") == {"set": True, "reason": ""}
    refused = run_json("param", "set", "mission", name, "99.0", code=1)
    assert not refused["set"] and "out of range" in refused["reason"]
    (file,) = yaml.safe_load(run_json("param", "dump", "mission").stdout).values()
    assert file["ros__parameters"][name] == 1.7
