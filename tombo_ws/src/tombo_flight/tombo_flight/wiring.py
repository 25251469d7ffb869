"""The wiring of a flight, as data: which cores there are and what each gets.

Who publishes a topic and who takes it follows from the cores' `inputs` and `outputs`. The headless
flight, the nodes, the replay and the documentation all read this.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tombo_collision.detector_core import DetectorCore
from tombo_collision.reaction_core import ReactionCore
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore, MissionLimits
from tombo_dynamics.core import Core
from tombo_flight.scenario import Scenario

CORES: tuple[type[Core], ...] = (
    EstimatorCore,
    DetectorCore,
    ReactionCore,
    MissionCore,
    ControllerCore,
)
"""The cores of a flight, in the order in which they are listed everywhere."""
PX4_REPLACES = (EstimatorCore, ControllerCore)
"""Cores whose place PX4 and the bridge to it take."""
SENSORS = ("/mocap/pose", "/imu/data_raw")
"""Topics that the simulator publishes and cores take."""
OPERATOR = ("/goal_pose",)
"""Topics that people and other programs publish."""
COMMAND = "/rotor_command"
"""Topic that the simulator takes."""


def records_of(core: type[Core], scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of a core, section → record; what no scenario says is the default."""
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
