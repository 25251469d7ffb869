"""What hover asks of the rotors, against statics by hand."""

import numpy as np
import pytest

from tombo_diagnosis.change.signatures import effects_of, hover_thrust
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_dynamics.vehicle import GRAVITY, ROTOR_NAMES


@pytest.fixture(scope="module")
def nominal():
    return nominal_model()


def test_a_weight_at_a_rotor_asks_for_three_quarters_there_and_frees_the_opposite_one(nominal):
    vehicle, share = nominal.vehicle, 0.04
    effects = effects_of("added_weight", "rear_left", share, vehicle)
    more = hover_thrust(vehicle, nominal.maps, effects) - vehicle.hover_thrust()
    weight = share * vehicle.mass * GRAVITY
    opposite, own, *beside = more / weight
    assert own == pytest.approx(0.75, abs=0.01)
    assert opposite == pytest.approx(-0.25, abs=0.01)
    assert beside == pytest.approx([0.25, 0.25], abs=0.01)


@pytest.mark.parametrize("rotor", ROTOR_NAMES)
def test_a_weak_propeller_asks_for_more_of_its_own_rotor_alone(nominal, rotor):
    weak = {"weak_propeller": {rotor: 0.1}}
    ratio = hover_thrust(nominal.vehicle, nominal.maps, weak) / nominal.vehicle.hover_thrust()
    k = ROTOR_NAMES.index(rotor)
    assert ratio[k] == pytest.approx(1.0 / 0.9, rel=2e-3)
    assert np.delete(ratio, k) == pytest.approx(np.ones(3), abs=2e-3)
