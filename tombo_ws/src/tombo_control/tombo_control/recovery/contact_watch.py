"""Contact trigger on the IMU: a blade strike is known some milliseconds after the touch."""

from __future__ import annotations

import math
from typing import Any

from tombo_control.autopilot import EstimatedState
from tombo_control.recovery.params import ContactParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Trigger
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotated
from tombo_dynamics.time_base import TICK_NS, TICK_S
from tombo_dynamics.vectors import norm
from tombo_dynamics.vehicle import ARM_X, ARM_Y, VehicleParams

_NOISE_TIME, _SMOOTH_TIME = 0.5, 0.02
"""s: time constants of the mean squares of vibration, and of the yaw rate without it."""
_MOMENT_SHARE = 0.2
"""Of the largest moment that the push can have: how clearly yaw shows it."""
_REST_SPEED = 0.05
"""m/s: a vehicle that was slower has no direction of flight; it is taken against the push."""


class ContactWatch(Record):
    """Memory of the contact trigger."""

    params = field("", "of the trigger", kind=ContactParams)
    mean_square = field("m^2/s^4", "of horizontal specific force, before a contact")
    above = field("1", "samples in a row above the threshold", kind=int)
    yaw_rate = field("rad/s", "low-passed, before a contact")
    yaw_square = field("rad^2/s^2", "mean square of the yaw rate about it")
    touch_tick = field("1", "of the first sample above the threshold", kind=int)
    gathers = field("1", "the rotor is not decided yet", kind=bool)
    push = field("m/s", "specific impulse since then, base_link x and y", 2)
    turning = field("m/s", "the same without the newest sample, as the gyro shows it", 2)
    position = field("m", "of base_link at the touch, map", 3)
    velocity = field("m/s", "at the touch, map", 3)
    tick = field("1", "of the decision", kind=int)
    rotor = field("1", "that was struck; -1: not known", kind=int)
    direction = field("1", "of the push on the vehicle, map, horizontal", 3)
    strength = field("m/s^2", "largest specific force of it")
    count = field("1", "contacts so far", kind=int)
    due = field("1", "there is one in this tick", kind=bool)


@compiled
def watch_contact(
    contact: ContactWatch,
    state: EstimatedState,
    nominal: VehicleParams,
    gyro: Array,
    accel: Array,
    tick: int,
    flies: bool,
) -> None:
    """Take an IMU sample; `contact.due` says that a contact is known with it.

    Args:
        contact: the trigger's memory.
        state: the estimate at this sample.
        nominal: mass, inertia and arms.
        gyro: (3) [rad/s], base_link.
        accel: (3) specific force [m/s^2], base_link.
        tick: of the sample.
        flies: False: the trigger is not armed.
    """
    contact.due = False
    ax = accel[0] - state.accel_bias[0]
    ay = accel[1] - state.accel_bias[1]
    square = ax * ax + ay * ay
    params = contact.params
    armed = flies and state.position[2] > params.arm_height
    if not armed or not math.isfinite(square + gyro[2]):
        contact.above = 0
        contact.gathers = False
        return
    limit = max(params.threshold**2, params.noise_factor**2 * contact.mean_square)
    share = TICK_S / _NOISE_TIME
    contact.mean_square += share * (min(square, limit) - contact.mean_square)
    if not contact.gathers and square <= limit:
        off = gyro[2] - contact.yaw_rate
        contact.yaw_rate += TICK_S / _SMOOTH_TIME * off
        contact.yaw_square += share * (off * off - contact.yaw_square)
    if contact.gathers:
        _gather(contact, ax, ay, square)
        if (tick - contact.touch_tick + 1) * TICK_S >= params.window - 1e-9:
            _decide(contact, state, nominal, gyro[2], tick)
    elif square > limit and (tick - contact.tick) * TICK_S > params.holdoff:
        if contact.above == 0:
            _begin(contact, state, tick)
        contact.above += 1
        _gather(contact, ax, ay, square)
        contact.gathers = contact.above >= params.samples
    else:
        contact.above = 0


@compiled(inline=False)
def _begin(contact: ContactWatch, state: EstimatedState, tick: int) -> None:
    contact.touch_tick = tick
    contact.push[0] = 0.0
    contact.push[1] = 0.0
    contact.strength = 0.0
    contact.position = state.position
    contact.velocity = state.velocity


@compiled
def _gather(contact: ContactWatch, ax: float, ay: float, square: float) -> None:
    contact.turning = contact.push
    contact.push[0] += TICK_S * ax
    contact.push[1] += TICK_S * ay
    contact.strength = max(contact.strength, math.sqrt(square))


@compiled(inline=False)
def _decide(
    contact: ContactWatch,
    state: EstimatedState,
    nominal: VehicleParams,
    yaw_rate: float,
    tick: int,
) -> None:
    """Say which rotor was struck: its arm points against the push, and has its moment in yaw."""
    contact.gathers = False
    contact.above = 0
    contact.due = True
    contact.count += 1
    contact.tick = tick
    px, py = contact.push[0], contact.push[1]
    size = math.sqrt(px * px + py * py)
    gained = nominal.inertia_zz * (yaw_rate - contact.yaw_rate)
    tx, ty = contact.turning[0], contact.turning[1]
    scale = nominal.mass * math.sqrt(tx * tx + ty * ty) * nominal.arm_length
    noise = nominal.inertia_zz * nominal.inertia_zz * contact.yaw_square
    variance = _MOMENT_SHARE * _MOMENT_SHARE * scale * scale + noise
    best = math.inf
    for i in range(4):
        moment = nominal.mass * nominal.arm_length * (ARM_X[i] * ty - ARM_Y[i] * tx)
        score = (gained - moment) ** 2 / variance + 1.0 + (px * ARM_X[i] + py * ARM_Y[i]) / size
        if score < best:
            best = score
            contact.rotor = i
    x, y, _ = rotated(state.attitude, (px, py, 0.0))
    flat = math.sqrt(x * x + y * y)
    contact.direction = (x / flat, y / flat, 0.0)


@compiled(inline=False)
def fill_event(contact: ContactWatch, stamp_ns: int, event: Any) -> None:
    """Write the contact that is due as a collision; `stamp_ns` is of the sample that decided."""
    event.stamp_ns = stamp_ns
    event.trigger = Trigger.IMU
    event.contact_stamp_ns = stamp_ns - (contact.tick - contact.touch_tick + 1) * TICK_NS
    event.contact_position = contact.position
    v, push = contact.velocity, contact.direction
    speed = norm(v)
    for i in range(3):
        event.flight_direction[i] = v[i] / speed if speed > _REST_SPEED else -push[i]
    event.confidence = 1.0
    event.statistic = contact.strength
    event.count = contact.count
    event.rotor = contact.rotor
    event.push = push
