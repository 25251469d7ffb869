"""Cores with the parameters of a scenario."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tombo_bag.qos import STATE
from tombo_bag.topics import TOPICS, TopicSpec
from tombo_control.planning.mission_memory import MissionLimits
from tombo_dynamics.core import Core
from tombo_dynamics.messages import typename_of
from tombo_flight.scenario import Scenario
from tombo_sim.wiring import CORES

NEW_TOPICS = {
    topic: TopicSpec(topic, typename_of(output.kind), STATE, 0.0, f"of core {core.name}")
    for core in CORES
    for topic, output in core.outputs.items()
    if topic not in TOPICS
}
"""Topics that a core of the wiring has brought with it."""
TOPICS |= NEW_TOPICS


def records_of(core: type[Core], scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of a core, section → record: the scenario's, else the defaults."""
    records = {
        section: getattr(scenario, section, None) or kind()
        for section, kind in core.sections.items()
    }
    if scenario.reaction.name in records:
        records[scenario.reaction.name] = scenario.reaction
    if core.sections.get("inputs") is MissionLimits:
        ground = scenario.vehicle.leg_height
        records["inputs"] = replace(records["inputs"], ground_height=ground)
    return records


def core_of(kind: type[Core], scenario: Scenario) -> Core:
    """Return a new core with the parameters of a scenario."""
    core = kind.make(records_of(kind, scenario))
    if "reaction" in kind.options:
        chosen = scenario.reaction
        core.set_params("reaction", chosen.name)
        if chosen.name not in kind.sections:  # one that came after the core, from a notebook
            core.set_params(chosen.name, chosen)
    return core
