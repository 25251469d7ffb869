"""Memory of the reaction, and its reasons to hold or to ignore a collision."""

from __future__ import annotations

from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import PositionSetpointRecord, ReactionStatusRecord
from tombo_dynamics.messages import Reason
from tombo_dynamics.records import Record, field

STAMPS = 16
SAME_CONTACT_NS = 400_000_000
"""Two triggers that place a contact nearer together than this have seen the same one."""


class HoldReason(Reason):
    """Why the reaction holds the vehicle where it is."""

    NONE = 0
    DETECTOR_SILENT = 1, "no message from the detector though poses come: holding"
    MISSION_SILENT = 2, "no set points of the mission: holding"
    TWO_PUBLISHERS = 3, "two nodes publish what only one may: holding"


class EventRefusal(Reason):
    """Why a collision is not reacted to. WAITS: until the mission's first set point."""

    NONE = 0
    NOT_FINITE = 1, "a collision with NaN or infinity"
    NOT_UNIT = 2, "a collision whose flight direction is no unit vector"
    STALE = 3, "a collision of long ago"
    FUTURE = 4, "a collision stamped in the future"
    DUPLICATE = 5
    ELSEWHERE = 6, "a collision far from the vehicle"
    NOT_FLYING = 7, "a collision while not flying"
    WAITS = 8
    WRONG_FRAME = 9, "a collision whose frame is not map"


class ReactionMemory(Record):
    """Memory of the reaction's core. Positions and directions in map."""

    active = field("1", "a decision holds", kind=bool)
    guides = field("1", "its reference is the set point", kind=bool)
    recovers = field("1", "the controller is to fly with the recovery's gains", kind=bool)
    reference = field("", "of the decision", kind=PositionSetpointRecord)
    reference_ns = field("ns", "when it was asked for", kind=int)
    contact_ns = field("ns", "when the last collision decided on touched", kind=int)
    trigger = field("1", "what has seen it, a `Trigger`", kind=int)
    x_c = field("m", "of the last decision: base_link at contact", 3)
    n_r = field("1", "unit vector from x_c to x_r", 3)
    x_r = field("m", "of the last decision: where to hold", 3)
    collisions = field("1", "decided on", kind=int)
    has_mission = field("1", "a set point of the mission has come", kind=bool)
    mission = field("", "its last set point", kind=PositionSetpointRecord)
    mission_ns = field("ns", "when it came, as in the next three", kind=int)
    odometry_ns = field("ns", "the last estimate", kind=int)
    velocity = field("m/s", "the estimate, base_link", 3)
    attitude = field("1", "the estimate, quaternion xyzw", 4)
    rates = field("rad/s", "the estimate, base_link", 3)
    mocap_ns = field("ns", "the last pose", kind=int)
    detector_ns = field("ns", "the last message of the detector", kind=int)
    has_position = field("1", "an estimate has come", kind=bool)
    position = field("m", "the estimate", 3)
    mission_at_x_r = field("1", "the mission has come to x_r itself", kind=bool)
    two_publishers = field("1", "two publish what only one may", kind=bool)
    holds = field("1", "it holds", kind=bool)
    waits = field("1", "it replaces a set point that is missing", kind=bool)
    waits_since_ns = field("ns", "since when", kind=int)
    hold = field("", "where it holds", kind=PositionSetpointRecord)
    setpoint = field("", "the last one published", kind=PositionSetpointRecord)
    publishes = field("1", "it is of the last step", kind=bool)
    has_published = field("1", "there was one", kind=bool)
    publish_due = field("1", "one is to be published at the next step", kind=bool)
    now_ns = field("ns", "of the last step", kind=int)
    stamps = field("ns", "of the last events: a ring", STAMPS, int)
    events = field("1", "entered into it", kind=int)
    pending = field("1", "events that wait for the mission's first set point", kind=int)
    why = field("1", "a `HoldReason`", kind=int)
    status = field("", "the last one published", kind=ReactionStatusRecord)
    changed = field("1", "the decision is another one than in it", kind=bool)
    status_due = field("1", "it is of the last step", kind=bool)


@compiled(inline=False)
def begin_reaction(memory: ReactionMemory) -> None:
    """Begin anew, with the last status and the recovery in use."""
    memory.active = False
    memory.guides = False
    memory.collisions = 0
    memory.contact_ns = -SAME_CONTACT_NS
    memory.changed = True
    memory.has_mission = False
    memory.has_position = False
    memory.mission_ns = 0
    memory.odometry_ns = 0
    memory.mocap_ns = 0
    memory.detector_ns = 0
    memory.mission_at_x_r = True
    memory.two_publishers = False
    memory.holds = False
    memory.waits = False
    memory.has_published = False
    memory.publish_due = False
    memory.setpoint.stamp_ns = 0
    memory.now_ns = 0
    memory.events = 0
    memory.pending = 0
