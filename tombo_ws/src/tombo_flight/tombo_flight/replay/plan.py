"""What each node needs to be replayed, and what it says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tombo_bag.topics import (
    COLLISION_EVENT,
    DETECTOR_STATUS,
    ESTIMATOR_STATUS,
    IMU,
    MISSION_SETPOINT,
    MISSION_STATUS,
    MOCAP_POSE,
    ODOMETRY,
    REACTION_STATUS,
    ROTOR_COMMAND,
    SETPOINT,
)


@dataclass(frozen=True)
class NodePlan:
    """What a node needs to be replayed, and what it says."""

    inputs: tuple[str, ...]
    """Topics without which it can't be replayed."""
    optional_inputs: tuple[str, ...]
    """Topics that are fed as well if they are there."""
    compared_outputs: tuple[str, ...]
    """Names of `outputs.SERIES`, or `events`, that are compared."""
    output_topics: tuple[str, ...]
    """Topics on which it alone speaks."""


NODES: dict[str, NodePlan] = {
    "detector": NodePlan(
        (MOCAP_POSE.name,),
        (),
        ("events", "statistic"),
        (COLLISION_EVENT.name, DETECTOR_STATUS.name),
    ),
    "mission": NodePlan(
        (ODOMETRY.name,),
        (REACTION_STATUS.name, SETPOINT.name),
        ("mission_setpoint", "phase"),
        (MISSION_SETPOINT.name, MISSION_STATUS.name),
    ),
    "reaction": NodePlan(
        (MISSION_SETPOINT.name, ODOMETRY.name),
        (MOCAP_POSE.name, DETECTOR_STATUS.name, COLLISION_EVENT.name),
        ("events", "setpoint", "x_r"),
        (SETPOINT.name, REACTION_STATUS.name),
    ),
    "estimator": NodePlan(
        (MOCAP_POSE.name, IMU.name),
        (MISSION_STATUS.name,),
        ("odometry_position", "odometry_attitude", "odometry_velocity"),
        (ODOMETRY.name, ESTIMATOR_STATUS.name),
    ),
    "controller": NodePlan(
        (IMU.name, ODOMETRY.name, ESTIMATOR_STATUS.name, SETPOINT.name),
        (),
        ("rotor_command",),
        (ROTOR_COMMAND.name,),
    ),
}


def outputs_of(nodes: Iterable[str]) -> list[str]:
    """Return the names of all that some nodes say."""
    return [name for node in nodes for name in NODES[node].compared_outputs]
