"""The watch over a flight: evaluates the conditions of `state_machine.TABLE` at each gyro sample.

Pure: ticks of 1 ms are its time. `begin_watch`, then `watch` at each sample; `memory.state` says
what the controller commands.
"""

from __future__ import annotations

import math
from typing import Any

from tombo_control.autopilot import Autopilot
from tombo_control.loops.position_control import BLIND_SPEED, LANDING_SPEED
from tombo_control.safety.flight_volume import outside_volume
from tombo_control.safety.params import LEAST_TILT_MAX, FlightVolume, SafetyParams
from tombo_control.safety.state_machine import (
    NO_ROW,
    Condition,
    SafetyState,
    deciding_row,
    row_condition,
    row_next,
)
from tombo_control.safety.touchdown import (
    TOUCH_IMPULSE,
    Touchdown,
    begin_touchdown,
    observe_ground,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotated
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vectors import dot, norm, subtract

NO_PHASE = -1
_NEVER = -1
_REST_SPEED, _BOOT_REST = 0.3, 3 * TICK_HZ // 2
"""m/s; ticks: how slow a vehicle that takes off is, and a new controller waits."""
_TAKEOFF_SETPOINT, _TAKEOFF_GRACE = 0.6, TICK_HZ
"""m: the first set point; ticks: after this a take-off is refused."""
_JUMP = 0.3
"""m: an estimate that moves by more in one tick has jumped; the vehicle has not."""
_DOWN_HEIGHT, _RETURN_HEIGHT, _LEARN_HEIGHT = 0.15, 0.4, 0.5
"""m above the place of take-off."""
_RETURN_DISTANCE, _RETURN_TICKS = 3.0, 3 * TICK_HZ // 10
_UPRIGHT = math.cos(LEAST_TILT_MAX)
_STUCK_SPEED, _STUCK_TICKS = 0.1, 3 * TICK_HZ
_OVERTURNED_TICKS = TICK_HZ
_ANSWER_TICKS = TICK_HZ
"""Time for the position to come back after a silence of the gyro."""


class Watch(Record):
    """Memory of the watch over one flight."""

    params = field("", "its limits", kind=SafetyParams)
    volume = field("", "where the vehicle may fly", kind=FlightVolume)
    state = field("1", "a `SafetyState`", kind=int)
    row = field("1", "of the table, that led there; -1: none", kind=int)
    changes = field("1", "of the state", kind=int)
    since = field("1", "tick at which the state began", kind=int)
    requests = field("1", "bits of `Condition`: kill, abort, new flight, until they are used",
                     kind=int)  # fmt: skip
    has_commanded = field("1", "it has been in command", kind=bool)
    idle_seen = field("1", "phase idle, or a command, with the rotors off", kind=bool)
    takeoff_commands = field("1", "that had been given when it latched", kind=int)
    takeoff_ticks = field("1", "ticks for which a take-off has been asked for", kind=int)
    rest_ticks = field("1", "ticks at rest", kind=int)
    known_ticks = field("1", "ticks with a known position", kind=int)
    limit_ticks = field("1", "ticks beyond a limit", kind=int)
    stuck_ticks = field("1", "ticks without sinking", kind=int)
    gap = field("1", "ticks of silence of the gyro; negative: the clock was set back; 0: none",
                kind=int)  # fmt: skip
    replaced = field("1", "tick at which the gyro came back from a silence; -1: not, or the "
                     "position is known since", kind=int)  # fmt: skip
    home = field("m", "where it took off, in map", 3)
    has_place = field("1", "it has been known where it is", kind=bool)
    place = field("m", "where it was last known, in map", 3)
    lost = field("m", "where the position was lost, in map", 3)
    may_return = field("1", "it was lost in normal flight", kind=bool)
    deadline = field("1", "tick at which the rotors stop in a descent", kind=int)
    yaw = field("rad", "heading when the descent began")
    touchdown = field("", "the test for the ground", kind=Touchdown)


@compiled(inline=False)
def begin_watch(watch: Watch) -> None:
    """Begin as a controller that has just started."""
    watch.state = SafetyState.OFF
    watch.row = NO_ROW
    watch.since = 0
    watch.requests = 0
    watch.has_commanded = False
    watch.idle_seen = False
    watch.takeoff_commands = 0
    watch.has_place = False
    watch.takeoff_ticks = 0
    watch.rest_ticks = 0
    watch.known_ticks = 0
    watch.limit_ticks = 0
    watch.stuck_ticks = 0
    watch.gap = 0
    watch.replaced = _NEVER
    watch.may_return = False
    watch.deadline = 0
    begin_touchdown(watch.touchdown)


@compiled
def rotors_off(watch: Watch) -> bool:
    """Return whether no rotor is to turn."""
    state = watch.state
    return bool(
        state == SafetyState.OFF or state == SafetyState.LATCHED or state == SafetyState.STANDBY
    )


@compiled
def descends(watch: Watch) -> bool:
    """Return whether the controller lands by itself."""
    return bool(watch.state == SafetyState.LAND or watch.state == SafetyState.BLIND)


@compiled
def update_safety_state(
    watch: Watch,
    autopilot: Autopilot,
    accel: Array,
    setpoint: Any,
    phase: int,
    tick: int,
    ticks: int,
    due: bool,
    known: bool,
    setpoint_late: bool,
) -> None:
    """Update the safety state with a gyro sample; write `state`.

    Args:
        watch: its memory, changed.
        autopilot: the controller's state and set points.
        accel: (3) specific force [m/s^2], base_link.
        setpoint: the last one, as it came.
        phase: of the last set point; `NO_PHASE`: none has come.
        tick: of the sample.
        ticks: since the last one.
        due: the position loop is due; only then a lost position counts.
        known: the position is known.
        setpoint_late: no set point has come in time.
    """
    state = autopilot.state
    height = state.position[2] - watch.home[2]
    flies = not rotors_off(watch)
    learns = flies and known and height > _LEARN_HEIGHT and not descends(watch)
    observe_ground(watch.touchdown, watch.params, autopilot, accel, ticks, learns)
    loops = autopilot.loops
    stopped = loops.reached_speed and watch.touchdown.impulse > TOUCH_IMPULSE
    if descends(watch) and stopped and not loops.touched:
        loops.touched = True
        loops.touch_speed = state.velocity[2]
    _update_counters(watch, state, phase, tick, ticks, known)
    if flies:
        conditions = _conditions_aloft(watch, state, phase, tick, due, known, setpoint_late)
    else:
        conditions = _conditions_on_ground(watch, state, setpoint, phase, ticks, known)
    conditions |= watch.requests
    watch.requests = 0
    watch.gap = 0
    row = deciding_row(watch.state, conditions)
    if row != NO_ROW:
        _enter(watch, autopilot, setpoint.takeoff_commands, row, tick)


@compiled
def _is_apart(a: Array, b: Array, limit: float) -> bool:
    off = subtract(a, b)
    return bool(not dot(off, off) <= limit * limit)


@compiled
def _is_apart_horizontally(a: Array, b: Array, limit: float) -> bool:
    """Return whether the horizontal distance of two places exceeds `limit` [m]."""
    x, y = a[0] - b[0], a[1] - b[1]
    return bool(not x * x + y * y <= limit * limit)


@compiled
def _update_counters(
    watch: Watch, state: Any, phase: int, tick: int, ticks: int, known: bool
) -> None:
    """Update the counters of how long each measured condition has lasted."""
    v, limits = state.velocity, watch.params
    speed = norm(v)
    _, _, upright = rotated(state.attitude, (0.0, 0.0, 1.0))
    watch.known_ticks = watch.known_ticks + ticks if known else 0
    if watch.gap > 0:
        watch.replaced = tick
    elif watch.known_ticks >= _RETURN_TICKS:
        watch.replaced = _NEVER
    watch.rest_ticks = watch.rest_ticks + ticks if known and speed < _REST_SPEED else 0
    fast = known and not speed <= limits.speed_max
    # the first comparison saves a cosine in most ticks
    tilted = not upright >= _UPRIGHT and not upright >= math.cos(limits.tilt_max)
    out = known and outside_volume(state.position, watch.volume) > watch.volume.margin
    watch.limit_ticks = watch.limit_ticks + ticks if fast or tilted or out else 0
    stuck = phase == Phase.LAND and abs(v[2]) < _STUCK_SPEED
    watch.stuck_ticks = watch.stuck_ticks + ticks if stuck else 0
    moved = watch.has_place and _is_apart_horizontally(state.position, watch.place, _JUMP)
    if known and not moved:
        watch.has_place = True
        watch.place = state.position


@compiled
def _bit(condition: int, holds: bool) -> int:
    return int(holds) << condition


@compiled
def _conditions_aloft(
    watch: Watch, state: Any, phase: int, tick: int, due: bool, known: bool, setpoint_late: bool
) -> int:
    limits, lasted = watch.params, (tick - watch.since) * TICK_S
    height = state.position[2] - watch.home[2]
    ground_phase = phase == Phase.IDLE or phase == Phase.LANDED
    conditions = _bit(Condition.DOWN, ground_phase and height < _DOWN_HEIGHT)
    conditions |= _bit(Condition.DOWN_ABOVE, ground_phase)
    conditions |= _bit(Condition.POSITION_LOST, watch.gap != 0 or (due and not known))
    if watch.state == SafetyState.BLIND and watch.known_ticks >= _RETURN_TICKS:
        back = watch.may_return and lasted <= limits.return_time and height > _RETURN_HEIGHT
        back = back and not _is_apart(state.position, watch.lost, _RETURN_DISTANCE)
        conditions |= _bit(Condition.POSITION_BACK, back)
        conditions |= _bit(Condition.POSITION_LATE, True)
    conditions |= _bit(Condition.SETPOINT_SILENT, setpoint_late)
    conditions |= _bit(Condition.SETPOINT_BACK, not setpoint_late)
    conditions |= _bit(Condition.HOLD_OVER, lasted > limits.hold_time)
    conditions |= _bit(Condition.LIMIT, watch.limit_ticks * TICK_S > limits.limit_time)
    conditions |= _bit(Condition.LAND_STUCK, watch.stuck_ticks >= _STUCK_TICKS)
    ground = watch.touchdown
    conditions |= _bit(Condition.TOUCHDOWN, ground.contact_ticks * TICK_S >= limits.touchdown_time)
    conditions |= _bit(Condition.OVERTURNED, ground.overturned_ticks >= _OVERTURNED_TICKS)
    conditions |= _bit(Condition.TIME_OVER, tick >= watch.deadline)
    replaced = watch.replaced >= 0 and tick - watch.replaced >= _ANSWER_TICKS
    conditions |= _bit(Condition.REPLACED, replaced)
    return conditions


@compiled
def _conditions_on_ground(
    watch: Watch, state: Any, setpoint: Any, phase: int, ticks: int, known: bool
) -> int:
    ground_phase = phase == Phase.IDLE or phase == Phase.LANDED
    commands = setpoint.takeoff_commands
    if phase == Phase.IDLE:  # a mission that was restarted counts from 0
        watch.takeoff_commands = min(watch.takeoff_commands, commands)
    begins = phase == Phase.IDLE or phase == Phase.TAKEOFF
    conditions = _bit(Condition.COMMANDED, begins and commands > watch.takeoff_commands)
    conditions |= _bit(Condition.DOWN, ground_phase and watch.rest_ticks >= _BOOT_REST)
    if watch.state == SafetyState.OFF and phase == Phase.IDLE:
        watch.idle_seen = True
    wants = phase == Phase.TAKEOFF and (watch.idle_seen or not watch.has_commanded)
    watch.takeoff_ticks = watch.takeoff_ticks + ticks if wants else 0
    if wants:
        _, _, upright = rotated(state.attitude, (0.0, 0.0, 1.0))
        ready = known and upright >= math.cos(watch.params.takeoff_tilt)
        rested = min(watch.rest_ticks, watch.takeoff_ticks)
        ready = ready and rested >= (1 if watch.idle_seen else _BOOT_REST)
        ready = ready and not _is_apart_horizontally(
            state.position, watch.place, watch.params.takeoff_distance
        )
        ready = ready and not _is_apart(state.position, setpoint.position, _TAKEOFF_SETPOINT)
        conditions |= _bit(Condition.TAKEOFF, ready)
    refused = watch.idle_seen and watch.takeoff_ticks > _TAKEOFF_GRACE
    conditions |= _bit(Condition.TAKEOFF_REFUSED, refused)
    flying = phase != NO_PHASE and not ground_phase
    conditions |= _bit(Condition.IN_FLIGHT, flying and not (wants and watch.idle_seen))
    return conditions


@compiled(inline=False)
def _enter(watch: Watch, autopilot: Autopilot, commands: int, row: int, tick: int) -> None:
    """Begin the next state."""
    state, loops = autopilot.state, autopilot.loops
    before = watch.state
    landed_before = descends(watch)
    watch.state = row_next(row)
    watch.row = row
    watch.since = tick
    watch.changes += 1
    if watch.state == SafetyState.FLY and before != SafetyState.HOLD:
        if before != SafetyState.BLIND:
            watch.home = state.position
        watch.has_commanded = True
        watch.idle_seen = False
    elif watch.state == SafetyState.BLIND:
        watch.may_return = before == SafetyState.FLY or before == SafetyState.HOLD
        watch.lost = state.position
    elif watch.state == SafetyState.LATCHED:
        watch.takeoff_commands = commands
    elif row_condition(row) == Condition.COMMANDED:
        watch.idle_seen = True
    if descends(watch):
        x, y, _ = rotated(state.attitude, (1.0, 0.0, 0.0))
        watch.yaw = math.atan2(y, x)
        autopilot.setpoint.position = state.position
        if not landed_before:
            height = max(state.position[2] - watch.home[2], 0.0)
            descent = 2.0 * height / min(BLIND_SPEED, LANDING_SPEED)
            watch.deadline = tick + int((descent + watch.params.blind_time) * TICK_HZ)
    if row_condition(row) == Condition.NEW_FLIGHT:
        begin_watch(watch)
        watch.row = row
    loops.lands = watch.state == SafetyState.LAND
    watch.limit_ticks = 0
    watch.stuck_ticks = 0
