"""The mission over estimates and the reaction's decisions, as its node would have seen them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_control.estimate import Setpoint
from tombo_control.mission import MissionParams
from tombo_control.mission_core import MissionCore, MissionLimits
from tombo_dynamics.rotation import body_to_map
from tombo_flight.replay.merge_streams import merge_by_arrival
from tombo_flight.replay.outputs import Series
from tombo_flight.replay.poses import vectors

Times = NDArray[np.int64]

PERIOD_NS = 20_000_000
_ODOMETRY, _REACTION, _REACTION_SETPOINT, _TICK = range(4)


def replay_mission(
    odometry: ColumnTable,
    reaction: ColumnTable | None,
    answers: Times,
    ticks: Times | None,
    params: MissionParams,
    ground_height: float,
) -> dict[str, Series]:
    """Feed everything in order of arrival.

    Args:
        odometry: columns of nav_msgs/Odometry.
        reaction: columns of tombo_msgs/ReactionStatus, if there are any.
        answers: arrival of the reaction's set points.
        ticks: when the recorded mission spoke; None: 50 times a second from the first estimate.
        params: of the mission.
        ground_height: height of a vehicle that stands on the ground [m].
    """
    course = MissionCore(params, replace(MissionLimits(), ground_height=ground_height))
    position = vectors(odometry, "pose.pose.position")
    attitude = vectors(odometry, "pose.pose.orientation", "xyzw")
    velocity = body_to_map(attitude, vectors(odometry, "twist.twist.linear"))
    arrived = odometry["log_time_ns"]
    decided = reaction if reaction is not None and "state" in reaction else None
    decisions: Times = np.zeros(0, np.int64)
    if decided is not None:
        decisions, x_r = decided["log_time_ns"], vectors(decided, "x_r")
        states, stamps = decided["state"].tolist(), decided["stamp_ns"].tolist()
        collisions = decided["collisions"].tolist()
    if ticks is None:
        ticks = np.arange(arrived[0], arrived[-1] + PERIOD_NS, PERIOD_NS)
    said: list[tuple[int, Setpoint]] = []
    phases: list[tuple[int, int]] = []
    for now, stream, row in merge_by_arrival(arrived, decisions, answers, ticks):
        if stream == _ODOMETRY:
            course.estimate(position[row], velocity[row], now)
        elif stream == _REACTION:
            course.reaction(states[row], x_r[row], collisions[row], stamps[row], now)
        elif stream == _REACTION_SETPOINT:
            course.reaction_alive(now)
        else:
            setpoint = course.tick(now)
            if setpoint is not None:
                said.append((now, setpoint))
                if not phases or phases[-1][1] != setpoint.phase:
                    phases.append((now, setpoint.phase))
    return {
        "mission_setpoint": Series(
            np.array([now for now, _ in said], np.int64),
            np.array([setpoint.position for _, setpoint in said]).reshape(-1, 3),
        ),
        "phase": Series(
            np.array([now for now, _ in phases], np.int64),
            np.array([float(phase) for _, phase in phases]).reshape(-1, 1),
        ),
    }
