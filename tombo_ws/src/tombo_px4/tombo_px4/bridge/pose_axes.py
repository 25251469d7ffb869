"""Which mistake in axes explains a pose, found by gravity and by PX4's own estimate.

At rest the accelerometer points up. Turned by the pose's attitude it must point along +z of
`map`. If it does only after one of the usual mistakes is undone, that mistake is named.
"""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector

_HALF = math.sqrt(0.5)
_Y_UP = np.array([_HALF, 0.0, 0.0, _HALF])
"""Turns axes with y up into axes with z up: (x, y, z) -> (x, -z, y)."""
_UPSIDE_DOWN = -0.9


def up_error(attitude: Array, accel: Array) -> float:
    """Return the angle [rad] between +z and the accelerometer's direction in map.

    Args:
        attitude: (4) xyzw of the pose.
        accel: (3) specific force at rest, base_link.
    """
    up = rotate_vector(attitude, accel) / float(np.linalg.norm(accel))
    return math.acos(min(max(float(up[2]), -1.0), 1.0))


def explain_up(attitude: Array, accel: Array, limit: float) -> str:
    """Return why the up axis is not +z; "" if it is."""
    error = up_error(attitude, accel)
    if error <= limit:
        return ""
    degrees = math.degrees(error)
    world = quaternion_multiply(_Y_UP, attitude)
    both = quaternion_multiply(world, conjugate(_Y_UP))
    first = np.roll(attitude, -1)
    if math.cos(error) < _UPSIDE_DOWN:
        return (
            "mocap attitude hangs upside down: at rest gravity points along +z; it is one of a"
            " z-down body (NED, FRD), or the body was defined upside down: send ENU and FLU"
        )
    if up_error(first, accel) <= limit:
        return (
            "mocap quaternion is w first: read as x y z w, the vehicle would lie"
            f" {degrees:.0f} deg off level; let the driver fill x, y, z, w"
        )
    if min(up_error(both, accel), up_error(world, accel)) <= limit:
        return (
            f"mocap pose is Y-up: read with z up, the vehicle would lie {degrees:.0f} deg off"
            " level; set the streamed up axis to Z (OptiTrack Motive: Streaming, Up Axis)"
        )
    return (
        f"mocap body is tilted by {degrees:.0f} deg against the autopilot: define the rigid body"
        " again with the vehicle level and its nose along +x"
    )


def explain_place(theirs: Array, ours: Array, limit: float) -> str:
    """Return which mistake in axes makes PX4's position (3) differ from the pose's (3); or "".

    The bridge itself turns poses into PX4's axes, so another one must be feeding PX4 as well.
    """
    x, y, z = (float(v) for v in ours)
    for mistake, place in (
        ("ENU taken for NED", (y, x, -z)),
        ("x and y exchanged", (y, x, z)),
        ("z upside down", (x, y, -z)),
        ("turned by 90 deg", (-y, x, z)),
        ("turned by -90 deg", (y, -x, z)),
        ("turned by 180 deg", (-x, -y, z)),
        ("mirrored in x", (-x, y, z)),
        ("mirrored in y", (x, -y, z)),
        ("Y-up", (x, -z, y)),
    ):
        if math.dist(place, theirs) <= limit < math.dist(place, (x, y, z)):
            return mistake
    return ""
