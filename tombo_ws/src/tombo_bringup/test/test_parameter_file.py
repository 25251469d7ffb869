"""The parameter file that is installed under config/ says what the records say."""

from pathlib import Path

from tombo_bringup.parameter_file import parameter_file
from tombo_dynamics.effects.compose import null_theta, pack_theta
from tombo_flight.scenario import Scenario, load_scenario

FILE = Path(__file__).parents[4] / "tombo_ws/src/tombo_bringup/config/all_parameters.yaml"


def test_file_is_up_to_date() -> None:
    assert FILE.read_text() == parameter_file(), (
        "config/all_parameters.yaml is stale: python -m tombo_bringup.parameter_file > that file"
    )


def test_file_is_the_default_scenario_with_effects_that_do_nothing() -> None:
    scenario = load_scenario(str(FILE))
    for section in ("vehicle", "control", "estimator", "mission", "detector", "reaction"):
        assert getattr(scenario, section) == getattr(Scenario(), section)
    assert (pack_theta(scenario.effects) == null_theta()).all()
