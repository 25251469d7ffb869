"""The keys of `tombo up`, pressed in flight while every node that may be dead is dead."""

from __future__ import annotations

import os
import signal

import pytest
from terminal import Terminal

from in_time import in_time
from ros_bench import die_with_the_test
from tombo_bag.topics import PX4_STATUS, ROTOR_COMMAND, TRUE_ODOMETRY

pytestmark = pytest.mark.real_time

pytest.importorskip("rclpy")
PATIENCE_S = 120.0
HELPERS = ("mission", "reaction", "detector", "recorder")
SETTINGS = ("takeoff_time=0.2", "climb_speed=1.0", "height=1.2", "land_time=3000")
SLOW = ("--speed", "0.4")
"""Without PX4, simulated time: a busy machine flies too."""


def up(folder, *arguments):
    settings = [word for value in SETTINGS for word in ("--set", f"mission.{value}")]
    words = ("up", "hover", *settings, "-o", "up", "--json", *arguments)
    return Terminal(words, folder, PATIENCE_S, die_with_the_test)


def wait_for(world, terminal, spec, condition):
    """Wait for a message; a terminal that nobody reads stops the command when it is full."""
    return world.wait_for(spec, condition, patience_s=PATIENCE_S, meanwhile=terminal.read)


def flies(world, terminal, dead):
    """Wait until it hovers, let nodes die, and wait until they have ended."""
    world.subscribe(TRUE_ODOMETRY, PX4_STATUS, ROTOR_COMMAND)
    wait_for(world, terminal, TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 1.0)
    nodes = terminal.wait(lambda e: e["event"] == "status")["nodes"]
    for name in dead:
        os.kill(nodes[name]["pid"], signal.SIGKILL)
    for _ in dead:
        assert terminal.wait(lambda e: e["event"] == "ended")["node"] in dead


def test_over_px4_it_holds_lands_and_stops_its_rotors_with_all_others_dead(world, tmp_path):
    with up(tmp_path, "--px4") as terminal:
        flies(world, terminal, HELPERS)
        terminal.press("h")
        assert terminal.answer("hold")["success"]
        terminal.press("l")
        assert terminal.answer("land")["success"]
        wait_for(world, terminal, PX4_STATUS, lambda m: m.mode == "land")
        terminal.press("kk")
        assert terminal.answer("kill")["success"]
        said = wait_for(world, terminal, PX4_STATUS, lambda m: "Disarmed by" in m.status_text)
        with in_time():
            assert "landing" not in said.status_text


def test_the_controller_lands_it_with_all_others_dead(world, tmp_path):
    with up(tmp_path, *SLOW) as terminal:
        flies(world, terminal, HELPERS)
        for key, request in (("h", "hold"), ("l", "land")):
            terminal.press(key)
            answer = terminal.answer(request)
            assert answer["success"] and "controller/abort" in answer["message"], answer
        wait_for(world, terminal, ROTOR_COMMAND, lambda m: max(m.speed) == 0.0)
        assert world.heard[TRUE_ODOMETRY.name][-1].pose.pose.position.z < 0.3


def test_two_strokes_stop_the_rotors_with_all_but_the_controller_dead(world, tmp_path):
    with up(tmp_path, *SLOW) as terminal:
        flies(world, terminal, (*HELPERS, "estimator"))
        terminal.press("kk")
        assert terminal.answer("kill")["success"]
        wait_for(world, terminal, ROTOR_COMMAND, lambda m: max(m.speed) == 0.0)
