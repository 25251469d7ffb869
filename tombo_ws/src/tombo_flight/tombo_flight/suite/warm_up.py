"""Goes through the cores of all nodes once, so that the nodes find their code compiled.

Otherwise the first start after a change would compile in three processes at once, in flight.
"""

from __future__ import annotations

from dataclasses import replace

from tombo_flight.run_wiring import run_wiring
from tombo_flight.scenario import Scenario, world_of
from tombo_sim.failsafe import Failsafe
from tombo_sim.simulator import Simulator
from tombo_sim.wiring import COMMAND

_SECONDS = 0.25


def warm_up_nodes(scenario: Scenario) -> int:
    """Fly a quarter of a second by the wiring, and the fail-safe; return the rotor commands.

    Raises:
        InputError: as `Simulator`.
    """
    topics: list[str] = []
    run_wiring(
        replace(scenario, duration=_SECONDS), 0, lambda topic, message: topics.append(topic)
    )
    simulator = Simulator(world_of(scenario), 0)
    failsafe = Failsafe(simulator, scenario.vehicle)
    failsafe.engage(0)
    for _ in range(2):
        simulator.advance(failsafe.command)
        failsafe.observe(simulator)
    return topics.count(COMMAND)
