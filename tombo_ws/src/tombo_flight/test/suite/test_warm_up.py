"""The rehearsal: a vehicle that can't fly is refused before a process starts."""

from __future__ import annotations

import pytest

from tombo_dynamics.errors import InputError
from tombo_flight.run_wiring import warm_up_nodes
from tombo_flight.scenario import load_scenario


def test_a_vehicle_that_starts_inside_the_obstacle_is_refused():
    with pytest.raises(InputError, match="does not start inside"):
        warm_up_nodes(load_scenario(settings=["obstacle.x=0.2", "obstacle.y=0"]))
