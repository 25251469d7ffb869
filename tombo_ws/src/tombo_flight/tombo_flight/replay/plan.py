"""Which nodes can be replayed, what each needs, and what of it is compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tombo_bag.topics import (
    COLLISION_EVENT,
    CONTACT_EVENT,
    DETECTOR_STATUS,
    GOAL_POSE,
    MISSION_STATUS,
    MOCAP_POSE,
    REACTION_STATUS,
    SETPOINT,
)
from tombo_collision.detector_core import DetectorCore
from tombo_collision.reaction_core import ReactionCore
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator_core import EstimatorCore
from tombo_control.mission_core import MissionCore
from tombo_dynamics.core import Core
from tombo_sim.wiring import CORES


@dataclass(frozen=True)
class NodePlan:
    """How a node is replayed."""

    core: type[Core]
    compared_outputs: tuple[str, ...]
    """Names of `outputs.SERIES`, or `events`."""
    optional_inputs: tuple[str, ...] = ()
    """Topics that are fed if they are there."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Topics without which it can't be replayed."""
        return tuple(t for t in self.core.inputs if t not in self.optional_inputs)


_PLANS = {
    plan.core: plan
    for plan in (
        NodePlan(DetectorCore, ("events", "statistic")),
        NodePlan(
            MissionCore,
            ("mission_setpoint", "phase"),
            (REACTION_STATUS.name, SETPOINT.name, GOAL_POSE.name),
        ),
        NodePlan(
            ReactionCore,
            ("events", "setpoint", "x_r"),
            (MOCAP_POSE.name, DETECTOR_STATUS.name, COLLISION_EVENT.name, CONTACT_EVENT.name),
        ),
        NodePlan(
            EstimatorCore,
            ("odometry_position", "odometry_attitude", "odometry_velocity"),
            (MISSION_STATUS.name,),
        ),
        NodePlan(ControllerCore, ("rotor_command",)),
    )
}
NODES = {core.name: _PLANS.get(core, NodePlan(core, ())) for core in CORES}
"""Those of the wiring; of a core without a plan nothing is compared."""


def outputs_of(nodes: Iterable[str]) -> list[str]:
    """Return the names of all that is compared of some nodes."""
    return [name for node in nodes for name in NODES[node].compared_outputs]
