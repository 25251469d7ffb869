"""The reflex in flight: its inputs, its fall, and unknown quantities."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import tombo_collision
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "settings"),
    [
        ("paper_collision", ()),
        ("paper_collision", ("disturbances=true",)),
        ("paper_collision", ("mission.approach_speed=1.2",)),
        ("pole", ()),
        ("pillar_right", ("disturbances=true",)),
        ("rear_hit", ()),
        ("side_hit", ("disturbances=true",)),
        ("paper_collision", ("propeller.conf=9",)),
    ],
)
def test_it_recovers_within_a_hands_breadth_or_two(scenario, settings):
    flown = load_scenario(scenario, ("reaction.name=reflex", *settings))
    summary = fly_scenario(flown, 11).summary
    assert not summary["crashed"] and summary["false_alarms"] == 0
    assert summary["struck_rotor"] == summary["contact_rotor"]
    assert 0.0 <= summary["contact_known_s"] <= 0.005
    clean = "disturbances=true" not in settings
    assert summary["max_falling_distance_m"] < (0.3 if clean else 0.7)
    assert summary["recovery_time_s"] < (2.0 if clean else 8.0)


@pytest.mark.slow
def test_without_the_imus_trigger_the_motion_capture_begins_it():
    settings = ("reaction.name=reflex", "contact.threshold=1000")
    summary = fly_scenario(load_scenario("paper_collision", settings), 11).summary
    assert summary["detected"] and summary["x_r_m"] is not None and not summary["crashed"]
    assert summary["struck_rotor"] is None and summary["contact_known_s"] > 0.01


def test_no_reaction_can_see_the_plant():
    """Reactions do not import modules of the simulation (fold, strike, obstacle)."""
    folder = Path(tombo_collision.__path__[0])
    hidden = ("tombo_sim", "tombo_flight", "tombo_dynamics.plant", "tombo_dynamics.effects")
    for path in (*folder.glob("reactions/*.py"), folder / "decision.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [one.name for one in node.names] if isinstance(node, ast.Import) else []
            assert not [n for n in names if n.startswith(hidden)], path
