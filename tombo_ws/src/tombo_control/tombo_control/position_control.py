"""Position P and velocity PID: from a position reference to attitude and collective thrust."""

from __future__ import annotations

import math

from tombo_control.autopilot import A, G
from tombo_control.estimator import to_map
from tombo_control.params import POSITION_TICKS
from tombo_control.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import normalize_quaternion
from tombo_dynamics.vehicle import GRAVITY

_PERIOD = POSITION_TICKS * 1e-3
_LOWEST_LIFT = 0.3 * GRAVITY


@compiled
def follow_leg(a: Array, time: float) -> None:
    """Write the reference of the current leg at `time` [s] into the set points."""
    duration = a[A.leg + 7] - a[A.leg + 6]
    way, speed, change = trapezoidal_profile(time - a[A.leg + 6], duration, a[A.leg + 8])
    for i in range(3):
        a[A.position_setpoint + i] = a[A.leg + i] + a[A.leg + 3 + i] * way
        a[A.velocity_reference + i] = a[A.leg + 3 + i] * speed
        a[A.velocity_setpoint + i] = a[A.velocity_reference + i]
        a[A.acceleration_setpoint + i] = a[A.leg + 3 + i] * change
    if a[A.leg + 11] != 0.0:
        turned, _, _ = trapezoidal_profile(time - a[A.leg + 6], a[A.leg + 12], a[A.leg + 13])
        a[A.leg + 9] = a[A.leg + 10] + a[A.leg + 11] * turned


@compiled
def position_control(a: Array, mass: float, thrust_max: float) -> None:
    """Run the 50 Hz loop: set points of attitude and collective thrust from position error.

    A P on position alone drives a double integrator and can't damp: as in PX4's `mc_pos_control`
    it asks for a velocity, and a PID on velocity asks for an acceleration.

    Args:
        a: the autopilot's memory; `velocity_setpoint` holds the feed-forward on entry and the
            limited set point on return.
        mass: nominal mass [kg].
        thrust_max: highest collective thrust [N].
    """
    vx = a[A.velocity_setpoint] + a[G.position_p] * (a[A.position_setpoint] - a[A.position])
    vy = a[A.velocity_setpoint + 1] + a[G.position_p] * (
        a[A.position_setpoint + 1] - a[A.position + 1]
    )
    vz = a[A.velocity_setpoint + 2] + a[G.position_p] * (
        a[A.position_setpoint + 2] - a[A.position + 2]
    )
    fast = math.sqrt(vx * vx + vy * vy) / a[G.velocity_max_xy]
    if fast > 1.0:
        vx /= fast
        vy /= fast
    vz = min(max(vz, -a[G.velocity_max_z]), a[G.velocity_max_z])
    a[A.velocity_setpoint], a[A.velocity_setpoint + 1], a[A.velocity_setpoint + 2] = vx, vy, vz

    ax = velocity_pid(a, 0)
    ay = velocity_pid(a, 1)
    az = velocity_pid(a, 2)
    lift = az + GRAVITY
    highest = thrust_max / mass
    free_z = True
    if lift < _LOWEST_LIFT:
        lift = _LOWEST_LIFT
        free_z = a[A.velocity_setpoint + 2] > a[A.velocity + 2]
    elif lift > highest:
        lift = highest
        free_z = a[A.velocity_setpoint + 2] < a[A.velocity + 2]
    across = math.sqrt(ax * ax + ay * ay)
    widest = lift * math.tan(a[G.tilt_max])
    free_xy = across <= widest
    if not free_xy:
        ax *= widest / across
        ay *= widest / across
    for i in range(3):
        if free_xy if i < 2 else free_z:
            error = a[A.velocity_setpoint + i] - a[A.velocity + i]
            total = a[A.velocity_integral + i] + a[G.velocity_i] * error * _PERIOD
            a[A.velocity_integral + i] = min(max(total, -a[G.velocity_i_max]), a[G.velocity_i_max])
        a[A.previous_velocity + i] = a[A.velocity + i]
    attitude_from_thrust(ax, ay, lift, a[A.leg + 9], a, A.attitude_setpoint)
    bx, by, bz = to_map(a, 0.0, 0.0, 1.0)
    wanted = mass * (ax * bx + ay * by + lift * bz)
    a[A.thrust_setpoint] = min(max(wanted, a[G.thrust_min] * thrust_max), thrust_max)


@compiled
def velocity_pid(a: Array, i: int) -> float:
    """Acceleration [m/s^2] that the velocity PID asks for along map axis `i`."""
    measured = (a[A.velocity + i] - a[A.previous_velocity + i]) / _PERIOD
    error = a[A.velocity_setpoint + i] - a[A.velocity + i]
    return float(
        a[A.acceleration_setpoint + i]
        + a[G.velocity_p] * error
        + a[A.velocity_integral + i]
        + a[G.velocity_d] * (a[A.acceleration_setpoint + i] - measured)
    )


@compiled
def attitude_from_thrust(fx: float, fy: float, fz: float, yaw: float, out: Array, i: int) -> None:
    """Write into `out[i:i+4]` the attitude whose body z is along (fx, fy, fz) in map.

    The shortest turn from upright to that direction, after the turn by `yaw` about map z.
    """
    n = math.sqrt(fx * fx + fy * fy + fz * fz)
    zx, zy, zz = fx / n, fy / n, fz / n
    # half-way rotation from (0, 0, 1) to z: (-zy, zx, 0, 1 + zz), then times the yaw quaternion
    tx, ty, tw = -zy, zx, 1.0 + zz
    s, c = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    out[i] = tx * c + ty * s
    out[i + 1] = ty * c - tx * s
    out[i + 2] = tw * s
    out[i + 3] = tw * c
    normalize_quaternion(out[i : i + 4])


@compiled
def level_descent(a: Array, mass: float) -> None:
    """Ask for level attitude at the present heading and a thrust just below the weight."""
    x, y, _ = to_map(a, 1.0, 0.0, 0.0)
    attitude_from_thrust(0.0, 0.0, 1.0, math.atan2(y, x), a, A.attitude_setpoint)
    a[A.thrust_setpoint] = a[G.blind_thrust] * mass * GRAVITY
    for i in range(3):
        a[A.velocity_integral + i] *= 0.98
        a[A.previous_velocity + i] = a[A.velocity + i]
