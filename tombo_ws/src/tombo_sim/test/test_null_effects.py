"""In a whole flight, an effect at null is not there, and one that is nearly null is nearly not."""

import numpy as np
import pytest
from kernel_flight import NOISY, fly_kernel

from tombo_dynamics.effects import REGISTRY, check_theta

every_effect = pytest.mark.parametrize("name", REGISTRY)


def at(name, share):
    """Return parameters between null (0) and typical (1)."""
    values = {p.name: p.null + share * (p.typical - p.null) for p in REGISTRY[name].theta}
    return check_theta({name: values}, "effects")


def others(name):
    return {key: values for key, values in NOISY.items() if key != name}


@every_effect
def test_at_null_the_log_is_the_same_to_the_last_bit(name):
    without = fly_kernel(others(name), seconds=0.3, seed=11)
    null = fly_kernel(others(name) | at(name, 0.0), seconds=0.3, seed=11)
    assert without.begins_like(null)
    assert (without.mocap == null.mocap).all()


@pytest.mark.slow
@every_effect
def test_nearly_null_the_flight_is_nearly_the_same(name):
    """What runs at null parameters, once it runs, does nothing. Battery: charge is kept then."""
    without = fly_kernel(others(name), seconds=0.3, seed=11)
    nearly = fly_kernel(others(name) | at(name, 1e-9), seconds=0.3, seed=11)
    for quantity in ("position", "velocity", "attitude", "rates", "rotor_speed", "gyro", "accel"):
        assert nearly[quantity] == pytest.approx(without[quantity], abs=1e-5)


@every_effect
def test_effect_of_typical_size_shows_in_flight(name):
    if REGISTRY[name].contact:
        pole = {"obstacle": (0.6, 0.3, 0.1, 3.0)}
        size, seconds = at(name, 1.0), 2.5
        context = {"contact_force": {}, "blade_strike": {}}.get(name, at("blade_strike", 1.0))
    else:
        pole, size, seconds = {}, at(name, 1.0), 6.0 if name == "mocap_dropouts" else 0.6
        context = {"linear_rotor_drag": {"d_xy": 0.3}} if name != "linear_rotor_drag" else {}
    without = fly_kernel(context, seconds=seconds, seed=12, **pole)
    typical = fly_kernel(context | size, seconds=seconds, seed=12, **pole)
    assert max(np.abs(typical[n] - without[n]).max() for n in without.columns) > 1e-3
