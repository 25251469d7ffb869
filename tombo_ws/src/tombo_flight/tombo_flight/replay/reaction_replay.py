"""The reaction between mission and controller, as its node would have seen them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_bag.columns import ColumnTable
from tombo_collision.detector import CollisionEvent
from tombo_collision.params import ReactionLimits, ReactionParams
from tombo_collision.reaction_core import ReactionCore, Setpoint, Status
from tombo_flight.replay.merge_streams import merge_by_arrival
from tombo_flight.replay.outputs import Event, Series
from tombo_flight.replay.poses import vectors

Times = NDArray[np.int64]

PERIOD_NS = 4_000_000
"""The node looks at the clock 250 times a second, whatever comes."""
_EVENT, _DETECTOR, _POSE, _ODOMETRY, _MISSION_SETPOINT, _CLOCK = range(6)


@dataclass(frozen=True)
class ReactionReplay:
    """What the reaction says, and the events it refused, by reason."""

    series: dict[str, Series]
    refused: dict[str, int]


def replay_reaction(
    mission_setpoints: ColumnTable,
    odometry: ColumnTable,
    poses: Times,
    detector_status_times: Times,
    events: Sequence[Event],
    params: ReactionParams,
) -> ReactionReplay:
    """Feed everything in order of arrival.

    Args:
        mission_setpoints: columns of the mission's tombo_msgs/PositionSetpoint.
        odometry: columns of nav_msgs/Odometry.
        poses: arrival of the motion capture's poses.
        detector_status_times: arrival of the detector's signs of life.
        events: of the detector.
        params: of the reaction.
    """
    core = ReactionCore(params, ReactionLimits())
    setpoints = _setpoints(mission_setpoints)
    position = vectors(odometry, "pose.pose.position")
    arrived = np.array([event.known_ns for event in events], np.int64)
    streams = (
        arrived,
        detector_status_times,
        poses,
        odometry["log_time_ns"],
        mission_setpoints["log_time_ns"],
    )
    times = np.concatenate(streams)
    clock = np.arange(times.min(), times.max() + PERIOD_NS, PERIOD_NS)
    refused: dict[str, int] = {}
    said: list[tuple[int, Setpoint]] = []
    states: list[tuple[int, Status]] = []
    status: Status | None = None
    for now, stream, row in merge_by_arrival(*streams, clock):
        if stream == _EVENT:
            why = core.event(_collision(events[row], row + 1), events[row].stamp_ns, now)
            if why:
                refused[why] = refused.get(why, 0) + 1
        elif stream == _DETECTOR:
            core.detector(now)
        elif stream == _POSE:
            core.mocap(now)
        elif stream == _ODOMETRY:
            core.odometry(position[row], now)
        elif stream == _MISSION_SETPOINT:
            core.mission(setpoints[row], now)
        if stream in (_EVENT, _MISSION_SETPOINT, _CLOCK):
            setpoint = core.tick(now)
            if setpoint is not None:
                said.append((now, setpoint))
            if core.status is not status:
                status = core.status
                states.append((now, status))
    return ReactionReplay(_series(said, states), refused)


def _series(
    said: Sequence[tuple[int, Setpoint]], states: Sequence[tuple[int, Status]]
) -> dict[str, Series]:
    stamps = np.array([now for now, _ in said], np.int64)
    changes = np.array([now for now, _ in states], np.int64)
    nowhere = np.full(3, np.nan)
    x_r = [s.reaction.x_r if s.reaction.collisions else nowhere for _, s in states]
    return {
        "setpoint": Series(stamps, np.array([s.position for _, s in said]).reshape(-1, 3)),
        "reaction_state": Series(
            changes, np.array([float(s.state) for _, s in states]).reshape(-1, 1)
        ),
        "x_r": Series(changes, np.array(x_r).reshape(-1, 3)),
    }


def _collision(event: Event, count: int) -> CollisionEvent:
    return CollisionEvent(
        event.stamp_ns * 1e-9,
        event.trigger,
        event.contact_ns * 1e-9,
        np.array(event.x_c),
        np.array(event.flight_direction),
        event.confidence,
        event.statistic,
        count,
    )


def _setpoints(table: ColumnTable) -> list[Setpoint]:
    position, velocity = vectors(table, "position"), vectors(table, "velocity")
    acceleration = vectors(table, "acceleration")
    pairs = zip(table["yaw"].tolist(), table["phase"].tolist(), strict=True)
    return [
        Setpoint(position[i], velocity[i], acceleration[i], yaw, phase)
        for i, (yaw, phase) in enumerate(pairs)
    ]
