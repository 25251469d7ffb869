"""The cascade: which loop runs in which tick, from set points to rotor speeds."""

from __future__ import annotations

from tombo_control.autopilot import Autopilot, EstimatedState, LoopMemory, Setpoint
from tombo_control.estimator import propagate, update_body_rates
from tombo_control.loops.inner_loops import (
    allocate,
    attitude_control,
    inertia_torque,
    rate_control,
)
from tombo_control.loops.position_control import begin_descent, descend, position_control
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_control.planning.leg import leg_reference
from tombo_control.recovery.folded_rotors import allocate_folded, available_thrust
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.time_base import TICK_S


@compiled
def stop_rotors(state: EstimatedState, setpoint: Setpoint, loops: LoopMemory) -> None:
    """Stop the rotors, forget the integrals, take motion as it is for the derivatives.

    Writes `setpoint.rotor_speed` and `loops`.
    """
    for i in range(4):
        setpoint.rotor_speed[i] = 0.0
    loops.rate_filtered = state.rates
    loops.previous_velocity = state.velocity
    for i in range(3):
        loops.velocity_integral[i] = 0.0
        loops.rate_integral[i] = 0.0
    begin_descent(loops)


@compiled
def run_control_loops(
    autopilot: Autopilot, maps: RotorMaps, position: bool, attitude: bool, blind: bool
) -> None:
    """Run the rate loop, and the position and the attitude loop if they are due.

    Reads the state, the parameters and the upper levels of the set point, writes the levels below
    them down to `setpoint.rotor_speed`.

    Args:
        autopilot: its set points of position, velocity (feed-forward) and acceleration are there
            when the position loop is due.
        maps: the rotor's table.
        position: the position loop is due.
        attitude: the attitude loop is due.
        blind: the position is not known: brake and descend.
    """
    state, setpoint, loops = autopilot.state, autopilot.setpoint, autopilot.loops
    recovery, nominal = autopilot.recovery, autopilot.nominal
    gains = recovery.gains if recovery.active else autopilot.gains
    if position:
        thrust_max = 4.0 * maps.thrust_highest
        if recovery.active:
            thrust_max = available_thrust(recovery, maps)
        if blind or loops.lands:
            descend(state, setpoint, loops, gains, nominal.mass, thrust_max)
        else:
            begin_descent(loops)
            position_control(
                state, setpoint, loops, gains, nominal.mass, thrust_max, recovery.active
            )
    if attitude:
        attitude_control(state, setpoint, gains)
    rate_control(state, setpoint, loops, gains)
    inertia_torque(state, setpoint, nominal)
    if recovery.active:
        allocate_folded(setpoint, loops, recovery, nominal, maps)
    else:
        allocate(setpoint, loops, nominal, maps)
    for i in range(4):
        setpoint.rotor_speed[i] = speed_for_thrust(maps, setpoint.rotor_thrust[i])


@compiled
def cascade(autopilot: Autopilot, maps: RotorMaps, tick: int) -> None:
    """Run the loops that are due in `tick` and set the rotor speeds, `setpoint.rotor_speed`.

    Position at 50 Hz, along `leg`, attitude at 250 Hz, rates at 1000 Hz. With mocap older than
    `blind_timeout` the vehicle brakes and descends; `mode_flown` says so.
    """
    mode = autopilot.mode_asked
    if mode == Phase.IDLE or mode == Phase.LANDED:
        autopilot.mode_flown = mode
        stop_rotors(autopilot.state, autopilot.setpoint, autopilot.loops)
        return
    position = tick % POSITION_TICKS == 0
    blind = False
    if position:
        time = tick * TICK_S
        blind = time - autopilot.mocap_time > autopilot.gains.blind_timeout
        autopilot.mode_flown = Phase.DESCEND_BLIND if blind else mode
        if not blind:
            setpoint = autopilot.setpoint
            position_now, velocity, acceleration, yaw = leg_reference(autopilot.leg, time)
            setpoint.position = position_now
            setpoint.velocity = velocity
            setpoint.acceleration = acceleration
            setpoint.yaw = yaw
    run_control_loops(autopilot, maps, position, tick % ATTITUDE_TICKS == 0, blind)


@compiled
def control_tick(
    autopilot: Autopilot,
    maps: RotorMaps,
    gyro: Array,
    tick: int,
    ticks: int,
    position: bool,
    attitude: bool,
    blind: bool,
) -> None:
    """Carry the state on to the gyro sample of `tick`, take it, and run the loops that are due.

    Args:
        autopilot: as in `run_control_loops`; state and history are written, too.
        maps: the rotor's table.
        gyro: (3) [rad/s], body frame.
        tick: tick of the sample.
        ticks: ticks since the sample before.
        position: the position loop is due.
        attitude: the attitude loop is due.
        blind: the position is not known.
    """
    propagate(autopilot.state, autopilot.history, tick, ticks)
    update_body_rates(autopilot.state, gyro)
    run_control_loops(autopilot, maps, position, attitude, blind)
