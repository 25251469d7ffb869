"""Test whether the vehicle stands on the ground, by accelerometer and thrust.

In flight the accelerometer shows the thrust over the mass, and the drag, whatever the manoeuvre;
a vehicle at rest on the ground shows gravity, however little its rotors give. So the test is the
share of the weight that neither thrust nor drag explains. PX4's land detector asks for the same
with other words: low thrust, and no motion.
"""

from __future__ import annotations

import math

from tombo_control.autopilot import Autopilot
from tombo_control.safety.params import SafetyParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vectors import add_scaled, all_finite, norm, subtract
from tombo_dynamics.vehicle import GRAVITY

_SMOOTHING = 0.05
"""s: of thrust and specific force: some rotor turns, less than a bounce."""
_SCALE_TIME = 3.0
"""s: in which the thrust per newton commanded is learnt."""
_SCALE_LOW, _SCALE_HIGH = 0.5, 1.5
_IMPULSE_TIME = 0.3
"""s: in which a push is forgotten."""
TOUCH_IMPULSE = 0.12
"""m/s: a third of the speed of a blind descent: the ground has stopped it."""
_REST_RATE = 0.5
"""rad/s: PX4's LNDMC_ROT_MAX is 20 deg/s."""
_REST_FORCE = 0.2
"""1: share of gravity by which the specific force may be off at rest."""
_LEVEL, _OVERTURNED = math.cos(0.35), math.cos(1.0)


class Touchdown(Record):
    """Memory of the ground test."""

    thrust = field("N", "that the rotors were asked for, behind their lag")
    smooth_thrust = field("N", "the same, smoothed")
    force = field("m/s^2", "specific force, smoothed, body", 3)
    scale = field("1", "thrust over thrust asked for, and over nominal mass: 1 as expected")
    push = field("1", "share of the weight that something else carries")
    impulse = field("m/s", "speed that this push has given or taken in the last moments")
    contact_ticks = field("1", "time on the ground [ticks]", kind=int)
    overturned_ticks = field("1", "time on its side [ticks]", kind=int)


@compiled
def begin_touchdown(memory: Touchdown) -> None:
    """Forget what was measured."""
    memory.thrust = 0.0
    memory.smooth_thrust = 0.0
    memory.scale = 1.0
    memory.push = 0.0
    memory.impulse = 0.0
    memory.contact_ticks = 0
    memory.overturned_ticks = 0
    memory.force = (0.0, 0.0, GRAVITY)


@compiled
def observe_ground(
    memory: Touchdown,
    params: SafetyParams,
    autopilot: Autopilot,
    accel: Array,
    ticks: int,
    learns: bool,
) -> None:
    """Take one sample; `contact_ticks` and `overturned_ticks` count on or begin anew.

    Args:
        memory: of the test, changed.
        params: `touchdown_push`.
        autopilot: thrust asked for, rates, attitude, nominal vehicle.
        accel: (3) specific force [m/s^2], base_link; not finite: the last one is taken.
        ticks: of 1 ms, since the last sample.
        learns: it flies well above the ground: the scale of the thrust is learnt.
    """
    nominal, rates = autopilot.nominal, autopilot.state.rates
    commanded = 0.0
    for i in range(4):
        commanded += autopilot.setpoint.rotor_thrust[i]
    passed = ticks * TICK_S
    share = min(passed / _SMOOTHING, 1.0)
    lag = min(passed / max(nominal.motor_time_constant, TICK_S), 1.0)
    memory.thrust += (commanded - memory.thrust) * lag
    memory.smooth_thrust += (memory.thrust - memory.smooth_thrust) * share
    if all_finite(accel):
        memory.force = add_scaled(memory.force, share, subtract(accel, memory.force))
    z = memory.force[2]
    expected = memory.smooth_thrust / nominal.mass
    if learns and expected > 0.3 * GRAVITY:
        ratio = min(max(z / expected, _SCALE_LOW), _SCALE_HIGH)
        memory.scale += (ratio - memory.scale) * passed / _SCALE_TIME
    memory.push = (z - memory.scale * expected) / GRAVITY
    memory.impulse += (memory.push * GRAVITY - memory.impulse / _IMPULSE_TIME) * passed
    total, turning = norm(memory.force), norm(rates)
    rests = abs(total - GRAVITY) < _REST_FORCE * GRAVITY and turning < _REST_RATE
    if rests and z > _LEVEL * total and memory.push > params.touchdown_push:
        memory.contact_ticks += ticks
    else:
        memory.contact_ticks = 0
    if rests and z < _OVERTURNED * total:
        memory.overturned_ticks += ticks
    else:
        memory.overturned_ticks = 0
