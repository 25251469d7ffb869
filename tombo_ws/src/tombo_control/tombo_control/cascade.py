"""The cascade: which loop runs in which tick, from set points to rotor speeds."""

from __future__ import annotations

from tombo_control.allocation import allocate, inertia_torque
from tombo_control.attitude_control import attitude_control
from tombo_control.autopilot import BLIND, IDLE, LANDED, A, G, N
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_control.position_control import follow_leg, level_descent, position_control
from tombo_control.rate_control import rate_control
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust

_TICK = 1e-3


@compiled
def stop_rotors(a: Array) -> None:
    """Stop the rotors, forget the integrals, take motion as it is for the derivatives."""
    for i in range(4):
        a[A.command + i] = 0.0
    for i in range(3):
        a[A.velocity_integral + i] = 0.0
        a[A.rate_integral + i] = 0.0
        a[A.rate_filtered + i] = a[A.rates + i]
        a[A.previous_velocity + i] = a[A.velocity + i]


@compiled
def run_control_loops(
    a: Array, maps: RotorMaps, position: bool, attitude: bool, blind: bool
) -> None:
    """Run the rate loop, and the position and the attitude loop if they are due.

    Args:
        a: the autopilot's memory; the set points of position, velocity (feed-forward) and
            acceleration are there when the position loop is due.
        maps: the rotor's table, `tombo_dynamics.rotor_maps`.
        position: the position loop is due.
        attitude: the attitude loop is due.
        blind: the position is not known: level and descend.
    """
    if position:
        if blind:
            level_descent(a, a[N.mass])
        else:
            position_control(a, a[N.mass], 4.0 * maps.thrust_highest)
    if attitude:
        attitude_control(a)
    rate_control(a)
    inertia_torque(a)
    allocate(a, maps.torque_ratio, maps.thrust_lowest, maps.thrust_highest)
    for i in range(4):
        a[A.command + i] = speed_for_thrust(maps, a[A.rotor_thrust + i])


@compiled
def cascade(a: Array, maps: RotorMaps, tick: int) -> None:
    """Run the loops that are due in `tick` and set the rotor speeds, `A.command`.

    Position at 50 Hz, attitude at 250 Hz, rates at 1000 Hz. With mocap older than
    `blind_timeout` the vehicle levels and descends.
    """
    mode = a[A.mode]
    if mode == IDLE or mode == LANDED:  # noqa: SIM109 - a tuple costs time when compiled
        a[A.mode + 1] = mode
        stop_rotors(a)
        return
    position = tick % POSITION_TICKS == 0
    blind = False
    if position:
        time = tick * _TICK
        blind = time - a[A.mode + 2] > a[G.blind_timeout]
        a[A.mode + 1] = BLIND if blind else mode
        if not blind:
            follow_leg(a, time)
    run_control_loops(a, maps, position, tick % ATTITUDE_TICKS == 0, blind)
