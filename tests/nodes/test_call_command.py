"""`tombo call` asks running nodes, and says what they answer."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys

import pytest

from tombo_bag.topics import MISSION_STATUS

pytest.importorskip("rclpy")
PATIENCE_S = 300.0


def call(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tombo_bringup.cli.main", "call", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)


def test_the_mission_answers_and_no_other_node_is_asked(world, start):
    world.subscribe(MISSION_STATUS)
    start("tombo_control.mission_node")
    world.meet(MISSION_STATUS, patience_s=PATIENCE_S)
    held = call("takeoff", "--json")
    answer = json.loads(held.stdout)
    assert answer["request"] == "takeoff" and answer["message"], held.stderr
    assert "no node offers" not in answer["message"]
    assert held.returncode == (0 if answer["success"] else 1)
    absent = call("kill")
    assert absent.returncode == 1
    assert "kill refused: no node offers controller/kill" in absent.stdout


def test_the_vehicle_of_a_namespace_is_asked(world, start):
    status = dataclasses.replace(MISSION_STATUS, name=f"/v2{MISSION_STATUS.name}")
    world.subscribe(status)
    start("tombo_control.mission_node", "-r", "__ns:=/v2")
    world.meet(status, patience_s=PATIENCE_S)
    answer = json.loads(call("takeoff", "--vehicle", "v2", "--json").stdout)
    assert answer["message"] and "no node offers" not in answer["message"]
    wrong = call("land", "--vehicle", "v 2")
    assert (wrong.returncode, wrong.stdout) == (2, "") and "accepted: a name" in wrong.stderr
