"""Memory of the mission, and the reasons for which its plan waits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tombo_control.planning.mission import MissionState
from tombo_dynamics.effects.downwash import MOST_OTHERS
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import MissionStatusRecord, PositionSetpointRecord
from tombo_dynamics.messages import Phase, ReactionPhase, Reason
from tombo_dynamics.params import param
from tombo_dynamics.records import field
from tombo_dynamics.vectors import UNKNOWN

NEVER = -1


class WaitReason(Reason):
    """Why the plan waits. From REACTION_HOLDS on it is the reaction that it waits for."""

    NONE = 0
    ESTIMATE_SILENT = 1, "no estimates: the plan stands still"
    TWO_ESTIMATORS = 2, "two nodes publish odometry: the plan stands still"
    REACTION_HOLDS = 3, "the reaction holds: the plan waits"
    BLIND = 4, "the reaction sees stale poses: the plan waits"
    REACTION_SILENT = 5, "no message from the reaction: the plan waits"
    OPERATOR = 6, "held by an operator: the plan waits"
    COMPANY = (
        7,
        "the set point is nearer to another vehicle than safety.separation: refused, it holds",
    )


@dataclass(frozen=True)
class MissionLimits:
    """Limits beyond which the plan waits, and the height of the ground."""

    estimate_timeout: float = param(
        0.25,
        "s",
        (0.02, 5.0),
        "silence of the estimator after which the plan's clock stands still",
        "as control.blind_timeout",
    )
    reaction_timeout: float = param(
        0.3,
        "s",
        (0.04, 10.0),
        "silence of the reaction, after its first message, after which the plan waits",
        "15 set points",
    )
    lag_max: float = param(
        0.5,
        "m",
        (0.05, 10.0),
        "the plan begins again from a vehicle this far behind a moving reference",
        "ten times the lag of an undisturbed flight",
    )
    escape_age: float = param(
        12.0,
        "s",
        (0.1, 600.0),
        "an older decision of the reaction is none to follow",
        "reaction.timeout",
    )
    ground_height: float = param(
        0.18,
        "m",
        (-1e3, 1e3),
        "height of a vehicle that stands on the ground; one 0.3 m higher is taken to fly",
        "vehicle.leg_height",
    )


class StatusEntry(MissionStatusRecord):  # type: ignore[misc, valid-type]
    """The mission's status, and what its text is made of."""

    wait_reason = field("1", "a `WaitReason`", kind=int)


class MissionMemory(MissionState):
    """Memory of the mission's core, where the plan stands first."""

    has_estimate = field("1", "the first estimate has come", kind=bool)
    started = field("1", "false: waits on the ground, the plan's clock at 0", kind=bool)
    takeoff_commands = field("1", "of an operator; `auto_start` is none", kind=int)
    wait_reason = field("1", "a `WaitReason`", kind=int)
    position = field("m", "last estimate, in map", 3)
    velocity = field("m/s", "last estimate, in map", 3)
    estimate_ns = field("ns", "when it came; -1: never, as in the next two", kind=int)
    answer_ns = field("ns", "when the reaction's last set point came", kind=int)
    now_ns = field("ns", "of the last step", kind=int)
    time_ns = field("ns", "flight time", kind=int)
    two_estimators = field("1", "two nodes publish odometry", kind=bool)
    operator_hold = field("1", "an operator has said hold", kind=bool)
    reaction = field("1", "the reaction's state", kind=int)
    decided_collisions = field("1", "number of collisions in the last one; -1: none", kind=int)
    decided_place = field("m", "x_r of the last decision taken, in map", 3)
    escape = field("m", "x_r to leave for, in map; NaN: none", 3)
    others = field("m", "other vehicles, in map; NaN: not seen yet", (MOST_OTHERS, 3))
    others_count = field("1", "of them", kind=int)
    separation = field("m", "from them, at the least")
    refused = field("m", "the set point that was refused for them, in map", 3)
    rest_since_s = field("s", "stands still since then")
    has_flown = field("1", "it has been in the air", kind=bool)
    has_lifted = field("1", "it has left the ground", kind=bool)
    setpoint = field("", "the newest", kind=PositionSetpointRecord)
    setpoint_due = field("1", "it is to be published", kind=bool)
    published_mode = field("1", "phase in the last status", kind=int)
    published_reason = field("1", "reason to wait in the last status", kind=int)
    status = field("", "the newest", kind=StatusEntry)
    status_due = field("1", "it is to be published: another phase, or reason", kind=bool)


@compiled(inline=False)
def begin_mission(memory: MissionMemory, started: bool) -> None:
    """Forget everything but what was published."""
    memory.has_estimate = False
    memory.started = started
    memory.takeoff_commands = 0
    memory.mode = Phase.IDLE
    memory.wait_reason = WaitReason.NONE
    memory.estimate_ns = NEVER
    memory.answer_ns = NEVER
    memory.now_ns = NEVER
    memory.time_ns = 0
    memory.two_estimators = False
    memory.operator_hold = False
    memory.reaction = ReactionPhase.IDLE
    memory.decided_collisions = NEVER
    memory.decided_place = memory.escape = UNKNOWN
    memory.rest_since_s = math.inf
    memory.has_flown = False
    memory.has_lifted = False
