"""The mission as a node sees it: estimates may stop, others may fail, and it may begin in flight.

`mission.py` knows the plan; this keeps the plan's clock, waits while the plan can't be flown, and
turns its legs into set points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_control import mission as plan
from tombo_control.autopilot import (
    APPROACH,
    HOLD,
    HOVER,
    IDLE,
    LAND,
    LANDED,
    PHASE_NAMES,
    REACT,
    TAKEOFF,
)
from tombo_control.estimate import Setpoint
from tombo_control.mission import MissionParams, MissionState
from tombo_control.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.core import Core
from tombo_dynamics.messages import MissionStatus, Odometry, PositionSetpoint, ReactionStatus
from tombo_dynamics.params import param
from tombo_dynamics.rotation import rotate_vectors

Array = NDArray[np.float64]

REACTION_IDLE, REACTING, REACTION_BLIND, REACTION_HOLDING = range(4)
"""States of the reaction, as in `tombo_msgs/ReactionStatus`."""
NO_ESTIMATE, TWO_ESTIMATES = "estimate_silent", "two_estimators"
REACTION_HOLDS, BLIND, REACTION_SILENT = "reaction_holds", "blind", "reaction_silent"
"""Why the plan waits."""
_WAITS = {
    NO_ESTIMATE: "no estimates: the plan stands still",
    TWO_ESTIMATES: "two nodes publish odometry: the plan stands still",
    REACTION_HOLDS: "the reaction holds: the plan waits",
    BLIND: "the reaction sees stale poses: the plan waits",
    REACTION_SILENT: "no word of the reaction: the plan waits",
}

_PLANNED = (IDLE, TAKEOFF, HOVER, APPROACH)
_MOVING = (TAKEOFF, HOVER, APPROACH)
_AIRBORNE = 0.3
"""m above the ground: it flies."""
_LOW, _BELOW, _REST, _REST_S = 0.1, 0.15, 0.15, 1.0
"""m above the ground, m below the plan, slower than m/s, for s: it stands there."""
_NO_LIFT_S = 9.0
"""s: the same, for a vehicle that has not lifted off yet. PX4 needs 3 to 5: mode and arming are
confirmed, rotors spin up (COM_SPOOLUP_TIME), thrust rises (MPC_TKO_RAMP_T); a refusal costs 1."""
_DRIFT = 0.05
"""m: a waiting reference follows the vehicle when it is further away."""
_MAX_CLOCK_STEP_NS = 100_000_000
"""The plan's clock goes on by no more than this at a time: the node may have been stopped."""
_CLOCK_SET_NS = 1_000_000_000


@dataclass(frozen=True)
class MissionLimits:
    """When the plan waits, and what it takes for granted."""

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
        "silence of the reaction, once it has spoken, after which the plan waits",
        "15 set points",
    )
    lag_max: float = param(
        0.5,
        "m",
        (0.05, 10.0),
        "the plan begins anew from a vehicle this far behind a moving reference",
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


class MissionCore(Core):
    """Keeps the plan's clock and state; `tick` gives the set point.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "mission"
    inputs = ("/odometry", "/reaction/status", "/setpoint")
    outputs = ("/mission/setpoint", "/mission/status")
    period_ns = 20_000_000
    steps_on_messages = False
    sections = {"mission": MissionParams, "inputs": MissionLimits}
    options = {"auto_start": (True, "false: wait on the ground until it is set to true")}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> MissionCore:
        """Return a new mission."""
        return cls(records["mission"], records["inputs"])

    def __init__(self, params: MissionParams, limits: MissionLimits, started: bool = True) -> None:
        super().__init__()
        self._published_state: tuple[int, str] | None = None
        self.params = params
        self.limits = limits
        self.started = started
        """False: waits on the ground, the plan's clock at 0."""
        self.wait_reason = ""
        """Why the plan waits; empty while it goes on."""
        self._reset()

    def on(
        self, topic: str, message: Odometry | ReactionStatus | PositionSetpoint, now_ns: int
    ) -> None:
        """Take an estimate, the reaction's status, or its set point as a sign of life."""
        if isinstance(message, Odometry):
            velocity = rotate_vectors(message.attitude, message.velocity)
            if not self.estimate(message.position, velocity, now_ns):
                self.health.report_event("odometry_not_finite", "odometry with NaN or infinity")
        elif isinstance(message, ReactionStatus):
            self.reaction(
                message.state, message.x_r.tolist(), message.collisions, message.stamp_ns, now_ns
            )
        else:
            self.reaction_alive(now_ns)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on with the plan; return its set point, and its status when that has changed."""
        setpoint = self.tick(now_ns)
        for why, text in _WAITS.items():
            self.health.fault(why, self.wait_reason == why and self.mode != IDLE, text)
        self.health.values["phase"] = PHASE_NAMES[self.mode]
        self.health.values["flight_time_s"] = round(self.time_s, 2)
        if setpoint is None:
            return []
        outputs: list[tuple[str, Any]] = [
            (
                "/mission/setpoint",
                PositionSetpoint(
                    now_ns,
                    setpoint.position,
                    setpoint.velocity,
                    setpoint.acceleration,
                    setpoint.yaw,
                    setpoint.phase,
                ),
            )
        ]
        state = (setpoint.phase, self.wait_reason)
        if state != self._published_state:
            self._published_state = state
            text = PHASE_NAMES[setpoint.phase].replace("_", " ")
            if self.wait_reason:
                text += f", waits: {_WAITS[self.wait_reason]}"
            outputs.append(("/mission/status", MissionStatus(now_ns, setpoint.phase, text)))
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take a changed plan ("mission"), other limits ("inputs"), or the word to start."""
        if section == "mission":
            self.params = params
        elif section == "inputs":
            self.limits = params
        else:
            self.started = bool(params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Stand still while two estimators speak."""
        if topic == "/odometry":
            self.multiple_publishers(several)

    def _reset(self) -> None:
        self.state: MissionState | None = None
        """Where the plan stands; None before the first estimate."""
        self.wait_reason = ""
        self._position: Array = np.zeros(3)
        self._velocity: Array = np.zeros(3)
        self._estimate_ns: int | None = None
        self._answer_ns: int | None = None
        self._two_estimators = False
        self._reaction = REACTION_IDLE
        self._last_decision: tuple[float, ...] = ()
        self._escape: Array | None = None
        self._time_ns = 0
        self._now_ns: int | None = None
        self._rest_since_s = math.inf
        self._has_flown = False

    @property
    def mode(self) -> int:
        """Phase of the plan."""
        return IDLE if self.state is None else self.state.mode

    @property
    def time_s(self) -> float:
        """Flight time: since the first estimate, without the times that there was none [s]."""
        return self._time_ns * 1e-9

    def estimate(self, position: Array, velocity: Array, now_ns: int) -> bool:
        """Take an estimate (3), (3), map; False: not finite, not taken."""
        if not math.isfinite(float(position.sum() + velocity.sum())):
            return False
        self._position, self._velocity, self._estimate_ns = position, velocity, now_ns
        return True

    def reaction_alive(self, now_ns: int) -> None:
        """Take note of a set point of the reaction: it is alive."""
        self._answer_ns = now_ns

    def multiple_publishers(self, multiple_publishers: bool) -> None:
        """Say whether two estimators speak."""
        self._two_estimators = multiple_publishers

    def reaction(
        self, state: int, x_r: Sequence[float], collisions: int, stamp_ns: int, now_ns: int
    ) -> None:
        """Take the reaction's status.

        Args:
            state: a number of ReactionStatus.
            x_r: (3) in map [m]; counts with a collision only.
            collisions: of this flight so far.
            stamp_ns: of the decision.
            now_ns: the present.
        """
        self._reaction = state
        place = tuple(float(v) for v in x_r)
        if state == REACTION_IDLE:
            self._escape = None
        if state == REACTION_IDLE or not math.isfinite(sum(place)):
            return
        known = (float(collisions), *place)
        if known == self._last_decision:
            return
        self._last_decision = known
        if now_ns - stamp_ns <= self.limits.escape_age * 1e9:
            self._escape = np.array(place)

    def tick(self, now_ns: int) -> Setpoint | None:
        """Go on to `now_ns`; return the set point, None before the first estimate."""
        if self._now_ns is not None and now_ns < self._now_ns - _CLOCK_SET_NS:
            self._reset()
        passed = 0 if self._now_ns is None else max(now_ns - self._now_ns, 0)
        self._now_ns = now_ns
        if self.state is None:
            if self._estimate_ns is None or self._two_estimators:
                return None
            self.state = self._begin()
            passed = 0
        waited, self.wait_reason = self.wait_reason, self._reason_to_wait(now_ns)
        if self.wait_reason in (NO_ESTIMATE, TWO_ESTIMATES):
            return self._setpoint(now_ns, still=True)
        if self.started or self.state.mode != IDLE:
            self._time_ns += min(passed, _MAX_CLOCK_STEP_NS)
        self._advance(waited)
        return self._setpoint(now_ns)

    def _begin(self) -> MissionState:
        ground = self.limits.ground_height
        self._has_flown = float(self._position[2]) > ground + _AIRBORNE
        if self._has_flown:
            return plan.initial_state_in_flight(self._position, ground)
        return plan.begin(self._position)

    def _reason_to_wait(self, now_ns: int) -> str:
        limits = self.limits
        if self._two_estimators:
            return TWO_ESTIMATES
        if self._estimate_ns is None or now_ns - self._estimate_ns > limits.estimate_timeout * 1e9:
            return NO_ESTIMATE
        if self.mode not in _PLANNED:
            return ""
        if self._reaction in (REACTION_HOLDING, REACTION_BLIND):
            return REACTION_HOLDS if self._reaction == REACTION_HOLDING else BLIND
        silent = self._answer_ns is not None and (
            now_ns - self._answer_ns > limits.reaction_timeout * 1e9
        )
        return REACTION_SILENT if silent else ""

    def _advance(self, waited: str) -> None:
        """Take the plan's next step, with a fresh estimate."""
        assert self.state is not None
        state, now, here = self.state, self.time_s, self._position
        if self._escape is not None:
            if state.mode not in (IDLE, LAND, LANDED):
                state = plan.start_reaction(state, self._escape, now)
            self._escape = None
        if state.mode == IDLE:
            state = plan.begin(here)
        if self._is_on_ground(state, now):
            self.state = plan.set_landed(state, now, here)
            return
        waiting = state.mode in _PLANNED and bool(self.wait_reason)
        off = self._tracking_error(state, now)
        if state.mode in _MOVING:
            if waiting:
                if not waited or off > _DRIFT:
                    state = plan.wait(state, now, here)
            elif (
                waited in (REACTION_HOLDS, BLIND, REACTION_SILENT)
                or (waited and off > _DRIFT)
                or (self._reference_moves(state, now) and off > self.limits.lag_max)
            ):
                state = plan.resume(state, self.params, now, here)
        late = state.mode != IDLE and now >= self.params.land_time
        ready = self.started or state.mode != IDLE
        if (ready and not waiting) or late:
            state = plan.advance_mission(state, self.params, now, here, self._velocity)
        self.state = state

    def _tracking_error(self, state: MissionState, now: float) -> float:
        """Return how far the vehicle is from the reference [m]."""
        return math.dist(state.leg.position(now), self._position.tolist())

    def _reference_moves(self, state: MissionState, now: float) -> bool:
        return any(state.leg.velocity) and now < state.leg.end_s

    def _is_on_ground(self, state: MissionState, now: float) -> bool:
        """Say whether the vehicle stands on the ground though it is to fly.

        It has crashed, or somebody has put it there; or it does not lift off.
        """
        height = float(self._position[2])
        if state.mode == IDLE:
            self._has_flown = False
        elif height > state.home[2] + _AIRBORNE:
            self._has_flown = True
        wanted = state.leg.position(state.leg.motion_end_s)[2]
        low = height < state.home[2] + _LOW and height < wanted - _BELOW
        slow = math.hypot(*self._velocity.tolist()) < _REST
        flies = state.mode in (TAKEOFF, HOVER, APPROACH, REACT, HOLD)
        if not (low and slow and flies) or self.wait_reason:
            self._rest_since_s = math.inf
            return False
        self._rest_since_s = min(self._rest_since_s, now)
        return now - self._rest_since_s >= (_REST_S if self._has_flown else _NO_LIFT_S)

    def _setpoint(self, now_ns: int, still: bool = False) -> Setpoint:
        """Return the reference at the present flight time; `still`: held where it is."""
        assert self.state is not None
        leg, now = self.state.leg, self.time_s
        _, speed, change = trapezoidal_profile(
            now - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s
        )
        if still:
            speed = change = 0.0
        cruise = np.array(leg.velocity)
        place = np.array(leg.position(now))
        return Setpoint(place, speed * cruise, change * cruise, leg.yaw_at(now), self.mode, now_ns)
