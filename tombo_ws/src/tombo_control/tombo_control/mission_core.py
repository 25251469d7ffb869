"""The mission as a node sees it: estimates may stop, others may fail, and it may begin in flight.

`mission.py` knows the plan; this keeps the plan's clock, waits while the plan can't be flown, and
turns its legs into set points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tombo_control.autopilot import (
    APPROACH,
    IDLE,
    LAND,
    LANDED,
    PHASE_NAMES,
    TAKEOFF,
)
from tombo_control.leg import Leg, leg_position, leg_yaw, motion_end
from tombo_control.mission import (
    MissionParams,
    MissionState,
    advance_mission,
    begin,
    compiled_plan,
    initial_state_in_flight,
    resume,
    set_landed,
    start_reaction,
    wait,
)
from tombo_control.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.core import Core
from tombo_dynamics.jit import compiled_call
from tombo_dynamics.message_records import POSITION_SETPOINT, message_of
from tombo_dynamics.messages import MissionStatus, Odometry, PositionSetpoint, ReactionStatus
from tombo_dynamics.params import as_tuple, param, tuple_type
from tombo_dynamics.rotation import rotate_vectors

Array = NDArray[np.float64]

REACTION_IDLE, REACTING, REACTION_BLIND, REACTION_HOLDING = range(4)
"""States of the reaction, as in `tombo_msgs/ReactionStatus`."""
_GOES_ON, _NO_ESTIMATE, _TWO_ESTIMATES, _REACTION_HOLDS, _BLIND, _REACTION_SILENT = range(6)
WAIT_REASONS = (
    "",
    "estimate_silent",
    "two_estimators",
    "reaction_holds",
    "blind",
    "reaction_silent",
)
"""Why the plan waits; empty while it goes on."""
_, NO_ESTIMATE, TWO_ESTIMATES, REACTION_HOLDS, BLIND, REACTION_SILENT = WAIT_REASONS
_WAITS = {
    NO_ESTIMATE: "no estimates: the plan stands still",
    TWO_ESTIMATES: "two nodes publish odometry: the plan stands still",
    REACTION_HOLDS: "the reaction holds: the plan waits",
    BLIND: "the reaction sees stale poses: the plan waits",
    REACTION_SILENT: "no word of the reaction: the plan waits",
}
_NEVER = -1
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


_Limits: Any = tuple_type(MissionLimits, "_Limits", __name__)

MISSION = np.dtype(
    [
        ("begun", np.bool_),  # the first estimate has come
        ("started", np.bool_),  # False: waits on the ground, the plan's clock at 0
        ("mode", np.int64),  # from here to settled_s: the `MissionState`, its leg flat
        ("start", np.float64, 3),
        ("velocity", np.float64, 3),
        ("leg", np.float64, 8),  # begin_s to hold_s of `Leg`
        ("home", np.float64, 3),
        ("steps", np.int64),
        ("settled_since_s", np.float64),
        ("settled_s", np.float64),
        ("wait_reason", np.int64),  # index in WAIT_REASONS
        ("estimate", np.float64, (2, 3)),  # position [m], velocity [m/s], map
        ("estimate_ns", np.int64),  # when it came; -1: never, as in the next two
        ("answer_ns", np.int64),  # when the reaction's last set point came
        ("now_ns", np.int64),  # of the last step
        ("time_ns", np.int64),  # flight time
        ("two_estimators", np.bool_),
        ("reaction", np.int64),  # the reaction's state
        ("decision", np.float64, 4),  # last one taken: number of collisions, x_r [m]; NaN: none
        ("escape", np.float64, 3),  # x_r to leave for [m]; NaN: none
        ("rest_since_s", np.float64),
        ("has_flown", np.bool_),
        ("setpoint", POSITION_SETPOINT),  # the newest
        ("published", np.int64, 2),  # phase and reason to wait of the last status
        ("status_due", np.bool_),  # the present ones are others
    ],
    align=True,
)
"""Memory of the mission's core."""


@compiled_call
def begin_mission(r: Any, started: bool) -> None:
    """Forget everything but what was published."""
    r.begun = False
    r.started = started
    r.mode = IDLE
    r.wait_reason = _GOES_ON
    r.estimate_ns = _NEVER
    r.answer_ns = _NEVER
    r.now_ns = _NEVER
    r.time_ns = 0
    r.two_estimators = False
    r.reaction = REACTION_IDLE
    for i in range(4):
        r.decision[i] = math.nan
    for i in range(3):
        r.escape[i] = math.nan
    r.rest_since_s = math.inf
    r.has_flown = False


@compiled_call
def mission_state(r: Any) -> MissionState:
    """Return where the plan stands."""
    t = r.leg
    leg = Leg(
        (r.start[0], r.start[1], r.start[2]),
        (r.velocity[0], r.velocity[1], r.velocity[2]),
        t[0],
        t[1],
        t[2],
        t[3],
        t[4],
        t[5],
        t[6],
        t[7],
    )
    home = (r.home[0], r.home[1], r.home[2])
    return MissionState(r.mode, leg, home, r.steps, r.settled_since_s, r.settled_s)


@compiled_call
def store_state(r: Any, state: MissionState) -> None:
    """Keep where the plan stands."""
    leg = state.leg
    for i in range(3):
        r.start[i] = leg.start[i]
        r.velocity[i] = leg.velocity[i]
        r.home[i] = state.home[i]
    r.leg[0], r.leg[1], r.leg[2] = leg.begin_s, leg.end_s, leg.ramp_s
    r.leg[3], r.leg[4], r.leg[5] = leg.yaw, leg.yaw_rate, leg.turn_s
    r.leg[6], r.leg[7] = leg.turn_ramp_s, leg.hold_s
    r.mode = state.mode
    r.steps = state.steps
    r.settled_since_s = state.settled_since_s
    r.settled_s = state.settled_s


@compiled_call
def take_estimate(r: Any, position: Array, velocity: Array, now_ns: int) -> bool:
    """Take an estimate (3), (3), map; False: not finite, not taken."""
    total = 0.0
    for i in range(3):
        total += position[i] + velocity[i]
    if not math.isfinite(total):
        return False
    for i in range(3):
        r.estimate[0, i] = position[i]
        r.estimate[1, i] = velocity[i]
    r.estimate_ns = now_ns
    return True


@compiled_call
def take_reaction(
    r: Any, limits: Any, state: int, x_r: Array, collisions: int, stamp_ns: int, now_ns: int
) -> None:
    """Take the reaction's status.

    Args:
        r: the mission's memory.
        limits: `MissionLimits`.
        state: a `ReactionPhase`.
        x_r: (3) in map [m]; counts with a collision only.
        collisions: of this flight so far.
        stamp_ns: of the decision.
        now_ns: the present.
    """
    r.reaction = state
    if state == REACTION_IDLE:
        r.escape[0] = math.nan
    if state == REACTION_IDLE or not math.isfinite(x_r[0] + x_r[1] + x_r[2]):
        return
    known = r.decision[0] == collisions
    for i in range(3):
        known = known and r.decision[1 + i] == x_r[i]
    if known:
        return
    r.decision[0] = collisions
    fresh = now_ns - stamp_ns <= limits.escape_age * 1e9
    for i in range(3):
        r.decision[1 + i] = x_r[i]
        if fresh:
            r.escape[i] = x_r[i]


@compiled_call
def mission_step(r: Any, plan: Any, limits: Any, now_ns: int) -> bool:
    """Go on to `now_ns`; write `setpoint` and return True, False before the first estimate."""
    if r.now_ns != _NEVER and now_ns < r.now_ns - _CLOCK_SET_NS:
        begin_mission(r, r.started)
    passed = 0 if r.now_ns == _NEVER else max(now_ns - r.now_ns, 0)
    r.now_ns = now_ns
    if not r.begun:
        if r.estimate_ns == _NEVER or r.two_estimators:
            return False
        r.begun = True
        r.has_flown = r.estimate[0, 2] > limits.ground_height + _AIRBORNE
        if r.has_flown:
            store_state(r, initial_state_in_flight(r.estimate[0], limits.ground_height))
        else:
            store_state(r, begin(r.estimate[0]))
        passed = 0
    waited = r.wait_reason
    r.wait_reason = _reason_to_wait(r, limits, now_ns)
    still = r.wait_reason == _NO_ESTIMATE or r.wait_reason == _TWO_ESTIMATES
    if not still:
        if r.started or r.mode != IDLE:
            r.time_ns += min(passed, _MAX_CLOCK_STEP_NS)
        _advance(r, plan, limits, waited)
    _set_point(r, now_ns, still)
    r.status_due = r.published[0] != r.mode or r.published[1] != r.wait_reason
    r.published[0], r.published[1] = r.mode, r.wait_reason
    return True


@compiled_call
def _is_planned(mode: int) -> bool:
    return mode == IDLE or TAKEOFF <= mode <= APPROACH


@compiled_call
def _reason_to_wait(r: Any, limits: Any, now_ns: int) -> int:
    if r.two_estimators:
        return _TWO_ESTIMATES
    if r.estimate_ns == _NEVER or now_ns - r.estimate_ns > limits.estimate_timeout * 1e9:
        return _NO_ESTIMATE
    if not _is_planned(r.mode):
        return _GOES_ON
    if r.reaction == REACTION_HOLDING:
        return _REACTION_HOLDS
    if r.reaction == REACTION_BLIND:
        return _BLIND
    if r.answer_ns != _NEVER and now_ns - r.answer_ns > limits.reaction_timeout * 1e9:
        return _REACTION_SILENT
    return _GOES_ON


@compiled_call
def _advance(r: Any, plan: Any, limits: Any, waited: int) -> None:
    """Take the plan's next step, with a fresh estimate."""
    state, now, here = mission_state(r), r.time_ns * 1e-9, r.estimate[0]
    if not math.isnan(r.escape[0]):
        if state.mode != IDLE and state.mode != LAND and state.mode != LANDED:
            state = start_reaction(state, r.escape, now)
        r.escape[0] = math.nan
    if state.mode == IDLE:
        state = begin(here)
    if _is_on_ground(r, state, now):
        store_state(r, set_landed(state, now, here))
        return
    waiting = _is_planned(state.mode) and r.wait_reason != _GOES_ON
    off = _tracking_error(state, now, here)
    if state.mode != IDLE and _is_planned(state.mode):
        if waiting:
            if waited == _GOES_ON or off > _DRIFT:
                state = wait(state, now, here)
        elif (
            waited >= _REACTION_HOLDS
            or (waited != _GOES_ON and off > _DRIFT)
            or (_reference_moves(state, now) and off > limits.lag_max)
        ):
            state = resume(state, plan, now, here)
    late = state.mode != IDLE and now >= plan.land_time
    ready = r.started or state.mode != IDLE
    if (ready and not waiting) or late:
        state = advance_mission(state, plan, now, here, r.estimate[1])
    store_state(r, state)


@compiled_call
def _tracking_error(state: MissionState, now: float, here: Array) -> float:
    """Return how far the vehicle is from the reference [m]."""
    x, y, z = leg_position(state.leg, now)
    x, y, z = x - here[0], y - here[1], z - here[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled_call
def _reference_moves(state: MissionState, now: float) -> bool:
    x, y, z = state.leg.velocity
    return (x != 0.0 or y != 0.0 or z != 0.0) and now < state.leg.end_s


@compiled_call
def _is_on_ground(r: Any, state: MissionState, now: float) -> bool:
    """Say whether the vehicle stands on the ground though it is to fly.

    It has crashed, or somebody has put it there; or it does not lift off.
    """
    height = r.estimate[0, 2]
    if state.mode == IDLE:
        r.has_flown = False
    elif height > state.home[2] + _AIRBORNE:
        r.has_flown = True
    _, _, wanted = leg_position(state.leg, motion_end(state.leg))
    low = height < state.home[2] + _LOW and height < wanted - _BELOW
    x, y, z = r.estimate[1, 0], r.estimate[1, 1], r.estimate[1, 2]
    slow = math.sqrt(x * x + y * y + z * z) < _REST
    flies = state.mode != IDLE and state.mode != LAND and state.mode != LANDED
    if not (low and slow and flies) or r.wait_reason != _GOES_ON:
        r.rest_since_s = math.inf
        return False
    r.rest_since_s = min(r.rest_since_s, now)
    return bool(now - r.rest_since_s >= (_REST_S if r.has_flown else _NO_LIFT_S))


@compiled_call
def _set_point(r: Any, now_ns: int, still: bool) -> None:
    """Write the reference at the present flight time; `still`: held where it is."""
    leg, now = mission_state(r).leg, r.time_ns * 1e-9
    _, speed, change = trapezoidal_profile(now - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s)
    if still:
        speed = 0.0
        change = 0.0
    place = leg_position(leg, now)
    out = r.setpoint
    for i in range(3):
        out.position[i] = place[i]
        out.velocity[i] = speed * leg.velocity[i]
        out.acceleration[i] = change * leg.velocity[i]
    out.yaw = leg_yaw(leg, now)
    out.phase = r.mode
    out.stamp_ns = now_ns


class MissionCore(Core):
    """Keeps the plan's clock and state in a record; `step` gives the set point.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "mission"
    inputs = ("/odometry", "/reaction/status", "/setpoint")
    outputs = ("/mission/setpoint", "/mission/status")
    period_ns = 20_000_000
    steps_on_messages = False
    sections: ClassVar[Mapping[str, type]] = {"mission": MissionParams, "inputs": MissionLimits}
    options: ClassVar[Mapping[str, tuple[Any, str]]] = {
        "auto_start": (True, "false: wait on the ground until it is set to true")
    }

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> MissionCore:
        """Return a new mission."""
        return cls(records["mission"], records["inputs"])

    def __init__(self, params: MissionParams, limits: MissionLimits, started: bool = True) -> None:
        super().__init__()
        self.plan = compiled_plan(params)
        self.limits = as_tuple(limits, _Limits)
        self.memory: Any = np.zeros(1, MISSION)[0]
        self.memory["published"] = -1
        begin_mission(self.memory, started)

    def on(
        self, topic: str, message: Odometry | ReactionStatus | PositionSetpoint, now_ns: int
    ) -> None:
        """Take an estimate, the reaction's status, or its set point as a sign of life."""
        if isinstance(message, Odometry):
            velocity = rotate_vectors(message.attitude, message.velocity)
            if not self.estimate(message.position, velocity, now_ns):
                self.health.report_event("odometry_not_finite", "odometry with NaN or infinity")
        elif isinstance(message, ReactionStatus):
            self.reaction(message.state, message.x_r, message.collisions, message.stamp_ns, now_ns)
        else:
            self.reaction_alive(now_ns)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on with the plan; return its set point, and its status when that has changed."""
        r = self.memory
        known = mission_step(r, self.plan, self.limits, now_ns)
        waits = self.wait_reason
        for why, text in _WAITS.items():
            self.health.fault(why, waits == why and self.mode != IDLE, text)
        self.health.values["phase"] = PHASE_NAMES[self.mode]
        self.health.values["flight_time_s"] = round(self.time_s, 2)
        if not known:
            return []
        setpoint = message_of(PositionSetpoint, r["setpoint"])
        outputs: list[tuple[str, Any]] = [("/mission/setpoint", setpoint)]
        if r["status_due"]:
            text = status_text(self.mode, int(r["wait_reason"]))
            outputs.append(("/mission/status", MissionStatus(now_ns, self.mode, text)))
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take a changed plan ("mission"), other limits ("inputs"), or the word to start."""
        if section == "mission":
            self.plan = compiled_plan(params)
        elif section == "inputs":
            self.limits = as_tuple(params, _Limits)
        else:
            self.memory["started"] = bool(params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Stand still while two estimators speak."""
        if topic == "/odometry":
            self.memory["two_estimators"] = several

    def estimate(self, position: Array, velocity: Array, now_ns: int) -> bool:
        """Take an estimate (3), (3), map; False: not finite, not taken."""
        return take_estimate(self.memory, position, velocity, now_ns)

    def reaction(
        self, state: int, x_r: Array, collisions: int, stamp_ns: int, now_ns: int
    ) -> None:
        """Take the reaction's status, see `take_reaction`."""
        take_reaction(self.memory, self.limits, state, x_r, collisions, stamp_ns, now_ns)

    def reaction_alive(self, now_ns: int) -> None:
        """Take note of a set point of the reaction: it is alive."""
        self.memory["answer_ns"] = now_ns

    @property
    def state(self) -> MissionState | None:
        """Where the plan stands; None before the first estimate."""
        return mission_state(self.memory) if self.memory["begun"] else None

    @property
    def mode(self) -> int:
        """Phase of the plan."""
        return int(self.memory["mode"])

    @property
    def wait_reason(self) -> str:
        """Why the plan waits, one of `WAIT_REASONS`."""
        return WAIT_REASONS[self.memory["wait_reason"]]

    @property
    def time_s(self) -> float:
        """Flight time: since the first estimate, without the times that there was none [s]."""
        return float(self.memory["time_ns"]) * 1e-9


def status_text(phase: int, wait_reason: int) -> str:
    """Return the text of `/mission/status`: the phase, and why the plan waits."""
    text = PHASE_NAMES[phase].replace("_", " ")
    if wait_reason:
        text += f", waits: {_WAITS[WAIT_REASONS[wait_reason]]}"
    return text
