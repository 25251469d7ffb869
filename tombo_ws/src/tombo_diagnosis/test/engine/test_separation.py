"""The advice on what separates the members of a set."""

from dataclasses import dataclass, field

import pytest

from tombo_diagnosis.engine.verdict import separating_experiment
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.propeller.effects import STAND_EFFECTS


@dataclass
class Effect:
    separates_from: dict[str, str] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("effects", "members", "text"),
    [
        (REGISTRY, ("steady_wind", "mocap_misalignment"), "wind"),
        (REGISTRY, ("mocap_misalignment", "steady_wind"), "wind"),
        (STAND_EFFECTS, ("thrust_coefficient", "thrust_gain"), "known weight"),
        ({"a": Effect(), "b": Effect()}, ("a", "b"), "No known measurement tells a and b apart"),
    ],
)
def test_a_set_has_the_advice_of_either_member(effects, members, text):
    experiment = separating_experiment(members, effects)
    assert experiment.effects == members
    assert text in experiment.text


@pytest.mark.parametrize("members", [(), ("steady_wind",)])
def test_without_a_set_nothing_is_proposed(members):
    assert separating_experiment(members, REGISTRY) is None
