"""The reaction in line between mission and controller: which set point goes on.

Without a collision it is the mission's, unchanged. After one it is x_r, at once, until the mission
flies there itself. Where mission or detector fall silent, the vehicle holds where it is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector import CollisionEvent
from tombo_collision.params import ReactionLimits, ReactionParams
from tombo_collision.reaction import IDLE as REACTION_IDLE
from tombo_collision.reaction import REACTING as REACTION_ACTIVE
from tombo_collision.reaction import ReactionState, react
from tombo_dynamics.core import ERROR, Core
from tombo_dynamics.messages import CollisionEvent as CollisionMessage
from tombo_dynamics.messages import (
    DetectorStatus,
    Odometry,
    Pose,
    PositionSetpoint,
    ReactionStatus,
    Trigger,
)

Array = NDArray[np.float64]

PHASE_IDLE, TAKEOFF, HOVER, APPROACH, REACT, HOLD, LAND, LANDED = range(8)
"""Phases of the flight, as in `tombo_msgs/MissionStatus`."""
IDLE, REACTING, BLIND, HOLDING = range(4)
"""States of the reaction, as in `tombo_msgs/ReactionStatus`."""
STATE_NAMES = ("idle", "reacting", "blind", "holding")

DETECTOR_SILENT, MISSION_SILENT = "detector_silent", "mission_silent"
TWO_PUBLISHERS = "two_publishers"
"""Why it holds."""
NOT_FINITE, NOT_UNIT, STALE, FUTURE = "not_finite", "not_unit", "stale", "future"
DUPLICATE, CONTACT_TOO_FAR, NOT_FLYING = "duplicate", "elsewhere", "not_flying"
"""Why an event is refused."""
_HOLDS = {
    DETECTOR_SILENT: "no word of the detector though poses come: holding",
    MISSION_SILENT: "no set points of the mission: holding",
    TWO_PUBLISHERS: "two nodes publish what only one may: holding",
}
_EVENT_REFUSALS = {
    NOT_FINITE: "a collision with NaN or infinity",
    NOT_UNIT: "a collision whose flight direction is no unit vector",
    STALE: "a collision of long ago",
    FUTURE: "a collision stamped in the future",
    CONTACT_TOO_FAR: "a collision far from the vehicle",
    NOT_FLYING: "a collision while not flying",
    "wrong_frame": "a collision whose frame is not map",
}
_EXCLUSIVE = ("/mission/setpoint", "/collision_event", "/detector/status")
"""Topics that only one may publish."""
_NOWHERE = np.full(3, np.nan)

_ON_GROUND = (PHASE_IDLE, LANDED)
_PLANNED = (PHASE_IDLE, TAKEOFF, HOVER, APPROACH)
_PERIOD_NS = 20_000_000
"""What no set point of the mission prompts is said at 50 Hz."""
_MAX_FUTURE_NS = 50_000_000
_MAX_CONTACT_DISTANCE = 3.0
"""m: a contact further away than this is not the vehicle's."""
_SAME_POSITION = 0.05
"""m: a set point this near to x_r is x_r."""
_CLOCK_SET_NS = 1_000_000_000


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class Setpoint:
    """Where the vehicle shall be (map, SI)."""

    position: Array
    velocity: Array = field(default_factory=_zeros)
    acceleration: Array = field(default_factory=_zeros)
    yaw: float = 0.0
    phase: int = PHASE_IDLE

    def finite(self) -> bool:
        """Return whether every number is finite."""
        total = self.position.sum() + self.velocity.sum() + self.acceleration.sum() + self.yaw
        return math.isfinite(total)


@dataclass(frozen=True)
class Status:
    """What the reaction does, for `/reaction/status`."""

    state: int = IDLE
    reaction: ReactionState = field(default_factory=ReactionState)
    why: str = ""
    """While HOLDING: one of the reasons above."""


class ReactionCore(Core):
    """Takes what arrives, in any order; `tick` says what to publish now.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "reaction"
    inputs = (
        "/mocap/pose",
        "/detector/status",
        "/odometry",
        "/mission/setpoint",
        "/collision_event",
    )
    outputs = ("/setpoint", "/reaction/status")
    period_ns = 5_000_000
    sections = {"reaction": ReactionParams, "inputs": ReactionLimits}
    options = {"react": (True, "false: collisions are seen, and nothing is done about them")}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> ReactionCore:
        """Return a new reaction."""
        return cls(records["reaction"], records["inputs"])

    def __init__(self, params: ReactionParams, limits: ReactionLimits, react: bool = True) -> None:
        super().__init__()
        self.params = params
        self.limits = limits
        self._react = react
        """False: collisions are seen, and nothing is done about them."""
        self._several: set[str] = set()
        self._refused = 0
        self._published_status: Status | None = None
        self._reset()
        self.status = Status(reaction=self._reaction)
        """Another object whenever something has changed."""

    def on(
        self,
        topic: str,
        message: Pose | DetectorStatus | Odometry | PositionSetpoint | CollisionMessage,
        now_ns: int,
    ) -> None:
        """Take a set point of the mission, a collision, an estimate, or a sign of life."""
        if isinstance(message, Pose):
            self.mocap(now_ns)
        elif isinstance(message, DetectorStatus):
            self.detector(now_ns)
        elif isinstance(message, Odometry):
            if not self.odometry(message.position, now_ns):
                self._refuse("odometry_not_finite", "odometry with NaN or infinity")
        elif isinstance(message, PositionSetpoint):
            setpoint = Setpoint(
                message.position,
                message.velocity,
                message.acceleration,
                message.yaw,
                message.phase,
            )
            if not self.mission(setpoint, now_ns):
                text = "a set point with NaN, infinity or an unknown phase: the last one stands"
                self._refuse("mission_not_finite", text)
        elif self._react:
            self._take_event(message, now_ns)

    def _take_event(self, message: CollisionMessage, now_ns: int) -> None:
        if message.frame_id.lstrip("/") != "map":
            why = "wrong_frame"
        else:
            event = CollisionEvent(
                1e-9 * message.stamp_ns,
                Trigger(message.trigger).name.lower() if message.trigger in (1, 2) else "unknown",
                1e-9 * message.contact_stamp_ns,
                message.contact_position,
                message.flight_direction,
                message.confidence,
                message.statistic,
                message.count,
            )
            why = self.event(event, message.stamp_ns, now_ns)
        if why and why != DUPLICATE:
            self._refuse(f"event_{why}", _EVENT_REFUSALS[why])

    def _refuse(self, key: str, text: str) -> None:
        self._refused += 1
        self.health.values["refused"] = self._refused
        self.health.report_event(key, text)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Decide; return the set point and the status, each when there is a new one."""
        outputs: list[tuple[str, Any]] = []
        setpoint = self.tick(now_ns)
        if setpoint is not None:
            outputs.append(
                (
                    "/setpoint",
                    PositionSetpoint(
                        now_ns,
                        setpoint.position,
                        setpoint.velocity,
                        setpoint.acceleration,
                        setpoint.yaw,
                        setpoint.phase,
                    ),
                )
            )
        status = self.status
        if status is not self._published_status:
            self._published_status = status
            done = status.reaction
            decided = done.state != REACTION_IDLE
            outputs.append(
                (
                    "/reaction/status",
                    ReactionStatus(
                        now_ns,
                        status.state,
                        done.x_c if decided else _NOWHERE,
                        done.x_r if decided else _NOWHERE,
                        done.n_r if decided else _NOWHERE,
                        done.collisions,
                    ),
                )
            )
            self.health.values["collisions"] = done.collisions
            for why, text in _HOLDS.items():
                self.health.fault(why, status.state == HOLDING and status.why == why, text, ERROR)
            blind = status.state == BLIND
            self.health.fault("blind", blind, "pose or estimate is too old", ERROR)
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take other parameters ("reaction"), limits ("inputs") or "react"; a decision stays."""
        if section == "reaction":
            self.params = params
        elif section == "inputs":
            self.limits = params
        else:
            self._react = bool(params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Hold while two publish what only one may."""
        (self._several.add if several else self._several.discard)(topic)
        self.multiple_publishers(any(each in self._several for each in _EXCLUSIVE))

    def _reset(self) -> None:
        self._reaction = ReactionState()
        self._mission_setpoint: Setpoint | None = None
        self._position: Array | None = None
        self._mission_setpoint_ns = self._odometry_ns = self._mocap_ns = self._detector_ns = 0
        self._mission_at_x_r = True
        self._two_publishers = False
        self._hold: Setpoint | None = None
        self._last: Setpoint | None = None
        self._publish_due = False
        self._published_ns = self._now_ns = 0
        self._stamps: deque[int] = deque(maxlen=16)
        self._pending_events: list[tuple[CollisionEvent, int]] = []

    def mission(self, mission_setpoint: Setpoint, now_ns: int) -> bool:
        """Take the mission's set point; False: not finite or of no known phase, not taken."""
        if not mission_setpoint.finite() or not 0 <= mission_setpoint.phase <= LANDED:
            return False
        self._mission_setpoint, self._mission_setpoint_ns, self._publish_due = (
            mission_setpoint,
            now_ns,
            True,
        )
        return True

    def odometry(self, position: Array, now_ns: int) -> bool:
        """Take the estimated position (3) [m]; False: not finite, not taken."""
        if not np.isfinite(position).all():
            return False
        self._position, self._odometry_ns = position, now_ns
        return True

    def mocap(self, now_ns: int) -> None:
        """Take note of a pose: the detector has something to look at."""
        if now_ns - self._mocap_ns > self.limits.pose_timeout * 1e9:
            self._detector_ns = max(self._detector_ns, now_ns)  # its time begins now
        self._mocap_ns = now_ns

    def detector(self, now_ns: int) -> None:
        """Take note of the detector's sign of life."""
        self._detector_ns = now_ns

    def multiple_publishers(self, multiple_publishers: bool) -> None:
        """Say whether two nodes publish what only one may."""
        self._two_publishers = multiple_publishers

    def event(self, event: CollisionEvent, stamp_ns: int, now_ns: int) -> str:
        """Take a collision, and decide; return why it was refused, or nothing.

        Before the mission's first set point it is kept until there is one.

        Args:
            event: the collision.
            stamp_ns: its stamp to the last digit; one that was seen before is a duplicate.
            now_ns: the present.
        """
        if stamp_ns in self._stamps:
            return DUPLICATE
        self._stamps.append(stamp_ns)
        if not math.isfinite(float(event.x_c.sum() + event.flight_direction.sum())):
            return NOT_FINITE
        length = math.sqrt(float(event.flight_direction @ event.flight_direction))
        if abs(length - 1.0) > 0.1:
            return NOT_UNIT
        if now_ns - stamp_ns > self.limits.event_age * 1e9:
            return STALE
        if stamp_ns - now_ns > _MAX_FUTURE_NS:
            return FUTURE
        if self._mission_setpoint is None:  # started in flight: it is a matter of milliseconds
            self._stamps.pop()
            self._pending_events = [*self._pending_events[-3:], (event, stamp_ns)]
            return ""
        if self._mission_setpoint.phase in (PHASE_IDLE, LAND, LANDED):
            return NOT_FLYING
        if self._position is not None:
            off = event.x_c - self._position
            if float(off @ off) > _MAX_CONTACT_DISTANCE**2:
                return CONTACT_TOO_FAR
        direction = event.flight_direction / length
        self._reaction = react(
            self._reaction, replace(event, flight_direction=direction), self.params
        )
        self._mission_at_x_r, self._publish_due = False, True
        return ""

    def tick(self, now_ns: int) -> Setpoint | None:
        """Decide; return the set point to publish now, None while there is nothing to say."""
        if now_ns < self._now_ns - _CLOCK_SET_NS:
            self._reset()
        self._now_ns = now_ns
        mission_setpoint = self._mission_setpoint
        if mission_setpoint is None:
            return None
        early, self._pending_events = self._pending_events, []
        for event, stamp_ns in early:
            self.event(event, stamp_ns, now_ns)
        if mission_setpoint.phase == LANDED and self._reaction.state == REACTION_ACTIVE:
            self._reaction = replace(self._reaction, state=REACTION_IDLE)
        elif mission_setpoint.phase == PHASE_IDLE and self._reaction.collisions:
            self._reaction = ReactionState()
        mission_timed_out = now_ns - self._mission_setpoint_ns > self.limits.mission_timeout * 1e9
        output, why = self._select_setpoint(mission_setpoint, mission_timed_out, now_ns)
        self._report(mission_setpoint, why, now_ns)
        own = output is not mission_setpoint
        if not self._publish_due and not (own and now_ns - self._published_ns >= _PERIOD_NS):
            return None
        self._publish_due, self._published_ns, self._last = False, now_ns, output
        return output

    def _select_setpoint(
        self, mission_setpoint: Setpoint, mission_timed_out: bool, now_ns: int
    ) -> tuple[Setpoint, str]:
        """Return the set point that holds now, and why it holds, if it does."""
        if self._reaction.state == REACTION_ACTIVE:
            if not self._mission_at_x_r and mission_setpoint.phase not in _PLANNED:
                off = mission_setpoint.position - self._reaction.x_r
                self._mission_at_x_r = (
                    mission_setpoint.phase == LAND or float(off @ off) < _SAME_POSITION**2
                )
            flies_on = mission_setpoint.phase in _PLANNED or not self._mission_at_x_r
            unsure = mission_timed_out or self._two_publishers
            if flies_on or (unsure and mission_setpoint.phase != LAND):
                self._hold = None
                return Setpoint(self._reaction.x_r, yaw=mission_setpoint.yaw, phase=REACT), ""
        why = self._reason_to_hold(mission_setpoint, mission_timed_out, now_ns)
        if not why or mission_setpoint.phase in _ON_GROUND:
            self._hold = None
            return mission_setpoint, why
        if self._hold is None:
            here = self._position
            if here is None or now_ns - self._odometry_ns > self.limits.pose_timeout * 1e9:
                here = (self._last or mission_setpoint).position
            self._hold = Setpoint(here, yaw=mission_setpoint.yaw, phase=HOLD)
        return self._hold, why

    def _reason_to_hold(
        self, mission_setpoint: Setpoint, mission_timed_out: bool, now_ns: int
    ) -> str:
        if mission_timed_out and mission_setpoint.phase not in _ON_GROUND:
            return MISSION_SILENT
        if self._two_publishers and mission_setpoint.phase != LAND:
            return TWO_PUBLISHERS
        poses = now_ns - self._mocap_ns <= self.limits.pose_timeout * 1e9
        detector_timed_out = now_ns - self._detector_ns > self.limits.detector_timeout * 1e9
        return (
            DETECTOR_SILENT
            if mission_setpoint.phase in _PLANNED and poses and detector_timed_out
            else ""
        )

    def _report(self, mission_setpoint: Setpoint, why: str, now_ns: int) -> None:
        old = self.limits.pose_timeout * 1e9
        stale = now_ns - self._odometry_ns > old or now_ns - self._mocap_ns > old
        if stale and mission_setpoint.phase not in _ON_GROUND:
            state = BLIND
        elif why:
            state = HOLDING
        elif self._reaction.state == REACTION_ACTIVE:
            state = REACTING
        else:
            state = IDLE
        known = self.status
        if (state, why) != (known.state, known.why) or known.reaction is not self._reaction:
            self.status = Status(state, self._reaction, why)
