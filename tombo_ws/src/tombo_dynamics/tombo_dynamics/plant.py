"""The memory of one simulated vehicle, as a record: cheap to copy, and fast in compiled code."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.vectors import add_scaled, vector
from tombo_dynamics.vehicle import VehicleParams

DELAY_TICKS = 64
"""Length of the ring of past commands: delays up to 63 ms."""


class State(Record):
    """State of the rigid body, or its slope: the derivative of each field."""

    position = field("m", "of the centre of gravity, map", 3)
    velocity = field("m/s", "map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)
    rates = field("rad/s", "body", 3)


class RotorSum(Record):
    """Sum of the four rotors at one time of the tick, body frame."""

    thrust = field("N", "along body z")
    moment = field("N m", "about the centre of gravity", 3)
    spin_momentum = field("N m s", "angular momentum of the rotors, along body z")


class ObstacleContact(Record):
    """Where the obstacle is touched in this tick."""

    touching = field("1", "a blade or the frame touches the obstacle", kind=bool)
    rotor = field("1", "rotor that touches; -1: the frame", kind=int)
    force = field("N", "on the frame, map", 3)
    point = field("m", "map", 3)


class Supply(Record):
    """The battery."""

    charge = field("A h", "used")
    current = field("A", "drawn")
    voltage = field("V", "at the drives")


class MocapSample(Record):
    """A motion-capture sample while the effects act on it."""

    position = field("m", "map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)
    interval = field("s", "since the capture before")
    latency = field("s", "from capture to arrival")
    stamp_error = field("s", "stamp later than the capture")
    dropped = field("1", "it never arrives", kind=bool)


class Obstacle(Record):
    """A vertical cylinder."""

    x = field("m", "of its axis, map")
    y = field("m", "of its axis, map")
    radius = field("m", "0: there is none")
    top = field("m", "height of its top, map")


class DisturbanceState(Record):
    """See `tombo_dynamics.disturbance`."""

    kind = field("1", "0: none", kind=int)
    params = field("", "in the order in which they are declared", 6)
    trailing_thrust = field("N", "what thrust the hysteresis is at")


class Plant(Record):
    """A vehicle: `map` is ENU, body is FLU. Effects with memory have theirs in `memories`."""

    state = field("", "at the tick's start, after `finish_tick` at its end", kind=State)
    start = field("", "the integrator's: state at the start of the tick", kind=State)
    slope = field("", "after `begin_tick`: at the start; later sums all slopes", kind=State)
    stage_slope = field("", "the integrator's: the latest slope", kind=State)
    rotation = field("1", "matrix of the attitude, map from body", (3, 3))
    airspeed = field("m/s", "velocity through the air, body", 3)
    force = field("N", "on the centre of mass, body, without gravity", 3)
    moment = field("N m", "about the centre of mass, body", 3)

    mass = field("kg", "true mass")
    inertia = field("kg m^2", "true moments of inertia xx, yy, zz", 3)
    centre_of_gravity = field("m", "true place, base_link x and y", 2)
    motor_time_constant = field("s", "true one")
    inverse_mass = field("1/kg", "1 / mass")
    inverse_inertia = field("1/(kg m^2)", "1 / inertia", 3)
    half_tick_decay = field("1", "of a gap to the target: what is left after half a tick")
    tick_decay = field("1", "what is left after a whole tick")
    clear_height = field("m", "above it nothing touches the floor")

    rotor_speed = field("rad/s", "positive whatever the direction of spin", 4)
    rotor_thrust = field("N", "of each rotor", 4)
    rotor_torque = field("N m", "aerodynamic drag torque, positive", 4)
    rotor_command = field("rad/s", "last asked for", 4)
    rotor_target = field("rad/s", "what the drives work towards in this tick", 4)
    past_commands = field("rad/s", "of the last ticks, a ring", (DELAY_TICKS, 4))
    efficiency = field("1", "factor on thrust and torque in this tick", 4)
    fold = field("1", "0: blade straight, 1: folded back at the nodus", 4)
    damage = field("1", "0: new; at 1 the blade tears off", 4)
    rotors = field("", "sum at start, middle and end of the tick", 3, kind=RotorSum)

    strike_force = field("N", "of blade strikes in this tick, body", 3)
    strike_moment = field("N m", "of blade strikes in this tick, body", 3)
    strike_energy = field("J", "kinetic energy that each rotor lost to strikes in this tick", 4)
    contact = field("", "with the obstacle", kind=ObstacleContact)
    wind = field("m/s", "velocity of the air in this tick, map", 3)
    supply = field("", "battery", kind=Supply)
    gyro = field("rad/s", "as measured, body", 3)
    accel = field("m/s^2", "specific force as measured, body", 3)
    mocap = field("", "the latest sample", kind=MocapSample)

    draws = field("1", "standard normal numbers drawn once a flight", 8)
    obstacle = field("", "", kind=Obstacle)
    ticks = field("1", "since the start", kind=int)
    tick_length = field("s", "")
    disturbance = field("", "a force that no effect describes", kind=DisturbanceState)
    vehicle = field("", "nominal parameters", kind=VehicleParams)


@compiled
def add_slope(to: State, source: State, slope: State, factor: float) -> None:
    """Write `source` + `factor` * `slope` into `to`, which may be `source` itself."""
    to.position = add_scaled(source.position, factor, slope.position)
    to.velocity = add_scaled(source.velocity, factor, slope.velocity)
    to.rates = add_scaled(source.rates, factor, slope.rates)
    for i in range(4):
        to.attitude[i] = source.attitude[i] + factor * slope.attitude[i]


@compiled
def copy_state(to: State, source: State) -> None:
    """Write `source` into `to`, number by number.

    A record copied as a whole can't be read before the copy has left the processor's store
    buffer, behind all else that is written: that was 7 % of a flight's time.
    """
    to.position = vector(source.position)
    to.velocity = vector(source.velocity)
    to.rates = vector(source.rates)
    for i in range(4):
        to.attitude[i] = source.attitude[i]


@compiled
def set_state(state: State, values: Array) -> None:
    """Write position, velocity, quaternion and rates (13, more are left alone) into `state`."""
    state.position = values[0:3]
    state.velocity = values[3:6]
    state.attitude = values[6:10]
    state.rates = values[10:13]
