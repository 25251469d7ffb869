"""The parameter file that is installed under config/ says what the records say."""

import re
from pathlib import Path

from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import null_theta, pack_theta
from tombo_flight.scenario import Scenario, load_scenario
from tombo_sim.propeller_effects import vehicle_effects

FILE = Path(__file__).parents[5] / "tombo_ws/src/tombo_bringup/config/all_parameters.yaml"


def test_file_is_the_default_scenario_with_effects_that_do_nothing() -> None:
    scenario = load_scenario(str(FILE))
    for section in ("vehicle", "control", "estimator", "mission", "detector", "reaction"):
        assert getattr(scenario, section) == getattr(Scenario(), section)
    assert (pack_theta(scenario.effects) == null_theta()).all()
    default = Scenario()
    follows = vehicle_effects(default.propeller, default.vehicle, {})
    assert not follows.keys() & scenario.effects.keys()
    assert follows.keys() | scenario.effects.keys() == REGISTRY.keys()


def test_what_follows_from_vehicle_and_propeller_is_there_behind_a_comment_sign(tmp_path) -> None:
    text = FILE.read_text()
    head, effects = text.split("\neffects:\n")
    lines = [
        line.replace("  # ", "  ", 1) if is_value(line) else line for line in effects.split("\n")
    ]
    (tmp_path / "all.yaml").write_text(f"{head}\neffects:\n" + "\n".join(lines))
    scenario = load_scenario(str(tmp_path / "all.yaml"))
    default = Scenario()
    assert vehicle_effects(default.propeller, default.vehicle, {}).items() <= (
        scenario.effects.items()
    )


def is_value(line: str) -> bool:
    """Whether a line is a key and perhaps a number behind a comment sign."""
    return re.fullmatch(r"  #  ? ?\w+:( [0-9.]+)?", line) is not None
