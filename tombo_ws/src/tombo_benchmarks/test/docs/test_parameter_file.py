"""The parameter file that is installed under config/ says what the records say."""

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
