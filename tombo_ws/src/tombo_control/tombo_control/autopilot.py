"""The memory of estimator and cascade: `Autopilot`, a record that compiled code and Python share.

`autopilot.state.position[2]` is the estimated height, `autopilot.gains.position_p` a gain of the
cascade, `autopilot.observer.mocap_rate` a parameter of the estimator.
"""

from __future__ import annotations

from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.planning.leg import LegRecord
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field, fill_record
from tombo_dynamics.vectors import ZERO, AnyVector, store
from tombo_dynamics.vehicle import VehicleParams

HISTORY_TICKS = 512
"""Length of the ring of past estimates: mocap samples up to half a second late are used."""
_NO_TICK = -1


class EstimatedState(Record):
    """Estimated state of the vehicle. `map` is ENU, body is FLU."""

    position = field("m", "of base_link, in map", 3)
    velocity = field("m/s", "of base_link, in map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)
    gyro_bias = field("rad/s", "what the gyro shows too much, body", 3)
    accel_bias = field("m/s^2", "what the accelerometer shows too much, body", 3)
    rates = field("rad/s", "body rates, bias removed, body", 3)


class PoseAtTick(Record):
    """A pose and the tick that it belongs to."""

    tick = field("1", "of 1 ms; -1: there is no pose", kind=int)
    position = field("m", "in map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)


class Setpoint(Record):
    """Set points of each level of the cascade, from the reference down to the rotors."""

    position = field("m", "in map", 3)
    velocity = field("m/s", "feed-forward; the position loop adds its share and limits it; map", 3)
    acceleration = field("m/s^2", "feed-forward, in map", 3)
    yaw = field("rad", "heading")
    attitude = field("1", "quaternion xyzw, map from body", 4)
    thrust = field("N", "collective thrust")
    rates = field("rad/s", "body rates, body", 3)
    angular_acceleration = field("rad/s^2", "body", 3)
    torque = field("N m", "that gives this acceleration, body", 3)
    rotor_thrust = field("N", "of each rotor", 4)
    rotor_speed = field("rad/s", "of each rotor: the command", 4)


class LoopMemory(Record):
    """Memory of the loops of the cascade."""

    velocity_integral = field("m/s^2", "acceleration of the velocity integral, in map", 3)
    previous_velocity = field("m/s", "at the last run of the position loop, in map", 3)
    rate_integral = field("rad/s^2", "angular acceleration of the rate integral, body", 3)
    rate_filtered = field("rad/s", "low-passed body rates, for the derivative, body", 3)
    saturated = field("1", "-1, 0, +1: no more roll, pitch, yaw torque in that direction", 3)
    lands = field("1", "down where it is: the set point's place holds across", kind=bool)
    descent_runs = field("1", "of the position loop since a descent began", kind=int)
    reached_speed = field("1", "the descent has had its speed", kind=bool)
    touched = field("1", "something has stopped the descent", kind=bool)
    touch_speed = field("m/s", "upwards, as it was known then")
    accelerometer_lost = field("1", "in a descent without position", kind=bool)
    stuck_runs = field("1", "of the position loop since it has no longer sunk", kind=int)
    thrust_cut = field("m/s^2", "what a descent that does not sink takes off the thrust")


class Recovery(Record):
    """State of folded rotors, and the gains for them."""

    active = field("1", "the cascade flies with these gains and limits", kind=bool)
    gains = field("", "in place of the cascade's", kind=ControlParams)
    recovery_time = field("s", "of a folded propeller, until 90 % of its thrust is back")
    fold = field("1", "folded share of each rotor, as it is observed", 4)
    share = field("1", "thrust of each rotor over that of a straight one", 4)
    difference = field("N", "of thrust within each diagonal, halved", 2)
    mean_lowest = field("N", "lowest mean of each diagonal", 2)
    mean_highest = field("N", "highest mean of each diagonal", 2)


class Autopilot(Record):
    """State, set points, memory and parameters of estimator and cascade."""

    state = field("", "the present estimate", kind=EstimatedState)
    history = field("", "past estimates, a ring: a tick's place is the tick modulo 512",
                    HISTORY_TICKS, PoseAtTick)  # fmt: skip
    mocap_time = field("s", "capture of the last mocap sample used")
    leg = field("", "the reference to fly", kind=LegRecord)
    setpoint = field("", "set points of the cascade", kind=Setpoint)
    loops = field("", "what the cascade remembers", kind=LoopMemory)
    mode_asked = field("1", "mode asked for", kind=int)
    mode_flown = field("1", "mode flown: the one asked for, or BLIND", kind=int)
    gains = field("", "parameters of the cascade", kind=ControlParams)
    recovery = field("", "while a rotor is folded", kind=Recovery)
    observer = field("", "parameters of the estimator", kind=EstimatorParams)
    nominal = field("", "the vehicle that is controlled for", kind=VehicleParams)


def new_autopilot(
    control: ControlParams,
    estimator: EstimatorParams,
    vehicle: VehicleParams,
    position: Array,
    attitude: Array,
) -> Autopilot:
    """Return the memory of an autopilot at rest, at a known position (3) and attitude (4)."""
    autopilot = Autopilot.new()
    autopilot.state.position = autopilot.setpoint.position = autopilot.leg.start = position
    autopilot.state.attitude = autopilot.setpoint.attitude = attitude
    autopilot.history["tick"] = _NO_TICK
    fill_record(autopilot.gains, control)
    fill_record(autopilot.recovery.gains, control)
    autopilot.recovery.share = 1.0
    fill_record(autopilot.observer, estimator)
    fill_record(autopilot.nominal, vehicle)
    return autopilot


@compiled
def restart_estimate(
    autopilot: Autopilot, position: AnyVector, velocity: AnyVector, attitude: Array
) -> None:
    """Begin the estimate again at a position (3), velocity (3) and attitude (4), without biases.

    Sets `state` and empties `history`.
    """
    state = autopilot.state
    store(state.position, position)
    store(state.velocity, velocity)
    store(state.attitude, attitude)
    state.gyro_bias = state.accel_bias = state.rates = ZERO
    for i in range(HISTORY_TICKS):
        autopilot.history[i].tick = _NO_TICK
