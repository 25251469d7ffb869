"""Position P and velocity PID: from a position reference to attitude and collective thrust."""

from __future__ import annotations

import math

from tombo_control.autopilot import EstimatedState, LoopMemory, Setpoint
from tombo_control.params import POSITION_TICKS, ControlParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import normalize_quaternion, rotated
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import GRAVITY

_PERIOD = POSITION_TICKS * TICK_S
_LOWEST_LIFT = 0.3 * GRAVITY
LANDING_SPEED, BLIND_SPEED = 0.4, 0.35
"""m/s: speed of a descent by the controller, with and without a position."""
_TRUST_RUNS = round(8.0 / _PERIOD)
"""So long the integrated accelerometer knows the velocity: an offset of 0.03 m/s^2 is 0.25 m/s."""
_REACHED_SHARE, _STUCK_SHARE, _STUCK_RUNS = 0.8, 0.6, round(0.16 / _PERIOD)
"""A descent that has had its speed, and now has less than this share, is held up by the ground."""
_FALLING_SPEED = 0.3
"""m/s: what seemed to be the ground was none if the vehicle sinks faster by this."""
_BEGIN_RUNS = round(1.0 / _PERIOD)
"""One that has not had its speed by then is, too."""
_CUT_RATE, _CUT_BACK, _CUT_MAX = 4.0, 2.0, 0.9 * GRAVITY
"""m/s^3, m/s^3, m/s^2: how fast the thrust is taken away there, and given back, and how much."""


@compiled
def position_control(
    state: EstimatedState,
    setpoint: Setpoint,
    loops: LoopMemory,
    gains: ControlParams,
    mass: float,
    thrust_max: float,
    height_first: bool,
) -> None:
    """Run the 50 Hz loop: set points of attitude and collective thrust from position error.

    A P on position alone drives a double integrator and can't damp: as in PX4's `mc_pos_control`
    it asks for a velocity, and a PID on velocity asks for an acceleration.

    Args:
        state: position, velocity and attitude are used.
        setpoint: position, velocity, acceleration and yaw are used; attitude and thrust are set,
            and velocity, the feed-forward on entry, is what is asked for on return.
        loops: `velocity_integral` and `previous_velocity` are used and set.
        gains: of the cascade.
        mass: nominal mass [kg].
        thrust_max: highest collective thrust [N].
        height_first: tilt no further than the thrust allows without loss of lift.
    """
    velocity, commanded = state.velocity, setpoint.velocity
    ex = setpoint.position[0] - state.position[0]
    ey = setpoint.position[1] - state.position[1]
    gain = stopping_gain(gains, math.sqrt(ex * ex + ey * ey))
    vx = commanded[0] + gain * ex
    vy = commanded[1] + gain * ey
    vz = commanded[2] + gains.position_p * (setpoint.position[2] - state.position[2])
    fast = math.sqrt(vx * vx + vy * vy) / gains.velocity_max_xy
    if fast > 1.0:
        vx /= fast
        vy /= fast
    vz = min(max(vz, -gains.velocity_max_z), gains.velocity_max_z)
    commanded[0], commanded[1], commanded[2] = vx, vy, vz

    ax = velocity_pid(state, setpoint, loops, gains, 0)
    ay = velocity_pid(state, setpoint, loops, gains, 1)
    az = velocity_pid(state, setpoint, loops, gains, 2)
    lift = az + GRAVITY
    highest = thrust_max / mass
    free_z = True
    if lift < _LOWEST_LIFT:
        lift = _LOWEST_LIFT
        free_z = commanded[2] > velocity[2]
    elif lift > highest:
        lift = highest
        free_z = commanded[2] < velocity[2]
    across = math.sqrt(ax * ax + ay * ay)
    widest = lift * math.tan(gains.tilt_max)
    if height_first:
        widest = min(widest, math.sqrt(max(highest * highest - lift * lift, 0.0)))
    free_xy = across <= widest
    if not free_xy:
        ax *= widest / across
        ay *= widest / across
    for i in range(3):
        if free_xy if i < 2 else free_z:
            error = commanded[i] - velocity[i]
            total = loops.velocity_integral[i] + gains.velocity_i * error * _PERIOD
            total = min(max(total, -gains.velocity_i_max), gains.velocity_i_max)
            loops.velocity_integral[i] = total
        loops.previous_velocity[i] = velocity[i]
    attitude_from_thrust(ax, ay, lift, setpoint.yaw, setpoint.attitude)
    bx, by, bz = rotated(state.attitude, (0.0, 0.0, 1.0))
    thrust = mass * (ax * bx + ay * by + lift * bz)
    thrust -= mass * loops.thrust_cut
    setpoint.thrust = min(max(thrust, gains.thrust_min * thrust_max), thrust_max)


@compiled
def stopping_gain(gains: ControlParams, distance: float) -> float:
    """Return the velocity to ask for over the distance [1/s].

    `position_p`, and further away what `brake` can stop: v^2 = 2 brake (distance - near / 2) with
    near = brake / position_p^2, where both have the same slope.
    """
    near = gains.brake / (gains.position_p * gains.position_p)
    if distance <= near:
        return gains.position_p
    return math.sqrt(2.0 * gains.brake * (distance - 0.5 * near)) / distance


@compiled
def velocity_pid(
    state: EstimatedState, setpoint: Setpoint, loops: LoopMemory, gains: ControlParams, axis: int
) -> float:
    """Acceleration [m/s^2] that the velocity PID asks for along a map axis."""
    measured = (state.velocity[axis] - loops.previous_velocity[axis]) / _PERIOD
    error = setpoint.velocity[axis] - state.velocity[axis]
    return float(
        setpoint.acceleration[axis]
        + gains.velocity_p * error
        + loops.velocity_integral[axis]
        + gains.velocity_d * (setpoint.acceleration[axis] - measured)
    )


@compiled
def attitude_from_thrust(fx: float, fy: float, fz: float, yaw: float, out: Array) -> None:
    """Write into `out` (4) the attitude whose body z is along (fx, fy, fz) in map.

    The shortest turn from upright to that direction, after the turn by `yaw` about map z.
    """
    n = math.sqrt(fx * fx + fy * fy + fz * fz)
    zx, zy, zz = fx / n, fy / n, fz / n
    # half-way rotation from (0, 0, 1) to z: (-zy, zx, 0, 1 + zz), then times the yaw quaternion
    tx, ty, tw = -zy, zx, 1.0 + zz
    s, c = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    out[0] = tx * c + ty * s
    out[1] = ty * c - tx * s
    out[2] = tw * s
    out[3] = tw * c
    normalize_quaternion(out)


@compiled
def begin_descent(loops: LoopMemory) -> None:
    """Forget the last descent: the next one begins anew."""
    loops.descent_runs = 0
    loops.reached_speed = False
    loops.touched = False
    loops.accelerometer_lost = False
    loops.stuck_runs = 0
    loops.thrust_cut = 0.0


@compiled
def descend(
    state: EstimatedState,
    setpoint: Setpoint,
    loops: LoopMemory,
    gains: ControlParams,
    mass: float,
    thrust_max: float,
) -> None:
    """Sink where the vehicle is, by the velocity loop; what does not sink loses its thrust.

    With `loops.lands` the position is known, and the place in `setpoint.position` is held across.
    Else velocity, carried on by the accelerometer, is braked, at the present heading; after some
    seconds, or without accelerometer, nobody knows it: the vehicle levels, with a thrust just
    below what had been needed.

    Args:
        state: as for `position_control`.
        setpoint: attitude and thrust are set.
        loops: as for `position_control`; counts, `reached_speed` and `thrust_cut` are set.
        gains: of the cascade.
        mass: nominal mass [kg].
        thrust_max: highest collective thrust [N].
    """
    speed = LANDING_SPEED if loops.lands else BLIND_SPEED
    loops.descent_runs += 1
    sinks = -state.velocity[2]
    if sinks > _REACHED_SHARE * speed or loops.descent_runs > _BEGIN_RUNS:
        loops.reached_speed = True
    if loops.touched and state.velocity[2] < loops.touch_speed - _FALLING_SPEED:
        loops.touched = False
    stuck = loops.reached_speed and (sinks < _STUCK_SHARE * speed or loops.touched)
    loops.stuck_runs = loops.stuck_runs + 1 if stuck else 0
    if loops.accelerometer_lost:
        loops.thrust_cut = 0.0
    elif loops.stuck_runs > _STUCK_RUNS:
        loops.thrust_cut = min(loops.thrust_cut + _CUT_RATE * _PERIOD, _CUT_MAX)
    else:
        loops.thrust_cut = max(loops.thrust_cut - _CUT_BACK * _PERIOD, 0.0)
    x, y, _ = rotated(state.attitude, (1.0, 0.0, 0.0))
    heading = math.atan2(y, x)
    place = setpoint.position
    if loops.lands:
        place[2] = state.position[2]
    else:
        setpoint.yaw = heading
        for i in range(3):
            place[i] = state.position[i]
    setpoint.velocity[0], setpoint.velocity[1], setpoint.velocity[2] = 0.0, 0.0, -speed
    for i in range(3):
        setpoint.acceleration[i] = 0.0
    trusted = loops.lands or not (loops.accelerometer_lost or loops.descent_runs > _TRUST_RUNS)
    if trusted:
        position_control(state, setpoint, loops, gains, mass, thrust_max, False)
    else:
        loops.previous_velocity = state.velocity
        lift = gains.blind_thrust * (GRAVITY + loops.velocity_integral[2]) - loops.thrust_cut
        least = gains.thrust_min * thrust_max
        setpoint.thrust = min(max(mass * lift, least), thrust_max)
    if loops.thrust_cut > 0.0 or not trusted:  # on the ground a tilt would make it slide
        attitude_from_thrust(0.0, 0.0, 1.0, heading, setpoint.attitude)
