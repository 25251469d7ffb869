"""From PX4's controls to rotors: order, spin, range, and where the vehicle hovers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_px4.hil.flight import MotorMapping
from tombo_sim.flight_setup import begin
from tombo_sim.world import SpreadParams, World

EVEN = {"thrust_scatter": {"deviation": 0.0}}
"""All rotors alike."""
WORLD = World(spread=SpreadParams(start=0.0, yaw=0.0, obstacle=0.0), effects=EVEN)
MAPS = begin(WORLD, 0).maps


def control_map(world: World = WORLD) -> MotorMapping:
    maps = MAPS if world is WORLD else begin(world, 0).maps
    return MotorMapping(world.vehicle, maps)


@pytest.mark.parametrize(("conf", "hover"), [(13, 0.460), (0, 0.314)])
def test_hover_is_where_the_documentation_says(conf, hover):
    world = World(propeller=PropellerChoice(conf=conf), spread=WORLD.spread, effects=EVEN)
    assert control_map(world).hover == pytest.approx(hover, abs=1e-3)


@given(st.lists(st.floats(width=32), min_size=4, max_size=4))
def test_rotors_stay_in_range_and_invalid_controls_are_taken_for_0(controls):
    speeds = control_map().speeds(controls, True)
    assert np.all((speeds >= 99.9) & (speeds <= 820.1))
    for control, speed in zip(controls, speeds, strict=True):
        if math.isnan(control) or control > 1.001:
            assert speed == pytest.approx(100.0, abs=0.1)


@pytest.mark.parametrize("motor", range(4))
def test_each_control_turns_its_rotor(motor):
    """PX4's motors: front right, rear left, front left, rear right."""
    controls = [0.2] * 4
    controls[motor] = 0.8
    fastest = int(np.argmax(control_map().speeds(controls, True)))
    x, y = WORLD.vehicle.rotor_positions()[fastest][:2]
    assert (x > 0, y > 0) == [(True, False), (False, True), (True, True), (False, False)][motor]
