"""The wiring of a flight, as data: which cores there are and what each gets.

Who publishes a topic and who takes it follows from the cores' `inputs` and `outputs`. The headless
flight, the nodes, the replay and `run_wiring` all read this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tombo_collision.detector_core import DetectorCore
from tombo_collision.reaction_core import ReactionCore
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore
from tombo_dynamics.core import Core
from tombo_flight.scenario import Scenario

SENSORS = ("/mocap/pose", "/imu/data_raw")
"""What the simulator senses and cores take."""
COMMAND = "/rotor_command"
"""What the simulator takes."""


def wiring(scenario: Scenario) -> tuple[type[Core], ...]:
    """Return the cores of a flight, in the order in which they are listed everywhere."""
    return (EstimatorCore, DetectorCore, ReactionCore, MissionCore, ControllerCore)


PX4_TAKES = ("estimator", "controller")
"""Cores whose place PX4 and the bridge to it take."""


def records_of(core: type[Core], scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of a core: section → record; what no scenario says is the default."""
    return {
        section: getattr(scenario, section, None) or kind()
        for section, kind in core.sections.items()
    }
