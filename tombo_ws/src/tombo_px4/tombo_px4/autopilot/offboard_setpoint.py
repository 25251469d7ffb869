"""Set points of OFFBOARD: which combinations PX4 accepts, and the reference of each axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_of

_NONE = np.full(3, math.nan)
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_LARGEST = 1e5
"""[m, m/s, m/s^2]: a larger value is refused as an error of the sender."""
_FASTEST = 100.0
"""[rad/s], the same."""


class ControlLevel(IntEnum):
    """The outermost loop that a set point drives, innermost last."""

    POSITION = 0
    VELOCITY = 1
    ACCELERATION = 2
    ATTITUDE = 3
    RATES = 4


@dataclass(frozen=True)
class OffboardSetpoint:
    """A set point of OFFBOARD: None or NaN means not commanded.

    Either motion (position, velocity, acceleration, yaw, yaw rate) or attitude (attitude, rates,
    thrust); with both, attitude is left out.
    """

    position: Array | None = None
    """(3) map [m]."""
    velocity: Array | None = None
    """(3) [m/s], in `frame`."""
    acceleration: Array | None = None
    """(3) without gravity [m/s^2], in `frame`."""
    yaw: float = math.nan
    """Counter-clockwise from east [rad]."""
    yaw_rate: float = math.nan
    """Counter-clockwise [rad/s]."""
    attitude: Array | None = None
    """(4) xyzw, map from base_link."""
    rates: Array | None = None
    """(3) base_link [rad/s]."""
    thrust: float | None = None
    """Share of the highest collective thrust, 0 to 1."""
    stamp_us: int = 0
    frame: str = "map"
    """`map`, or `body`: x ahead, y left, z up, level; a position is left out then."""


@dataclass(frozen=True)
class ResolvedSetpoint:
    """A set point after all checks: the reference of the cascade, each axis in map."""

    kind: ControlLevel
    position: Array = field(default_factory=lambda: _NONE)
    """(3) [m], NaN: not commanded."""
    velocity: Array = field(default_factory=lambda: _NONE)
    """(3) [m/s]."""
    acceleration: Array = field(default_factory=lambda: _NONE)
    """(3) [m/s^2]."""
    yaw: float = math.nan
    """Counter-clockwise from east [rad]."""
    yaw_rate: float = math.nan
    """Counter-clockwise [rad/s]."""
    attitude: Array = field(default_factory=lambda: _LEVEL)
    """(4) xyzw, map from base_link, for ATTITUDE."""
    rates: Array = field(default_factory=lambda: np.zeros(3))
    """(3) base_link [rad/s], for RATES; for ATTITUDE only the yaw rate's feed-forward."""
    thrust: float = math.nan
    """Share of the highest collective thrust."""


def resolve_setpoint(target: OffboardSetpoint, attitude: Array) -> ResolvedSetpoint | str:
    """Return a set point after all checks, or why it is refused.

    Args:
        target: as it came.
        attitude: (4) xyzw estimate at its arrival, which turns `body` into map.
    """
    position = _axes(target.position)
    velocity = _axes(target.velocity)
    acceleration = _axes(target.acceleration)
    if position is None or velocity is None or acceleration is None:
        return "set point has a wrong shape"
    if max(_most(position), _most(velocity), _most(acceleration)) > _LARGEST:
        return "set point is out of range"
    if np.isfinite([position, velocity, acceleration]).any():
        return _resolve_motion(target, position, velocity, acceleration, attitude)
    return _resolve_attitude(target)


def _axes(values: Array | None) -> Array | None:
    """Return three axes, infinities as not commanded; None for another shape."""
    if values is None:
        return _NONE
    axes = np.array(values, dtype=float)
    if axes.shape != (3,):
        return None
    axes[~np.isfinite(axes)] = math.nan
    return axes


def _most(axes: Array) -> float:
    """Return the largest absolute value of the commanded axes; 0 if there are none."""
    return float(np.nan_to_num(np.abs(axes)).max())


def finite_or_nan(value: float | None) -> float:
    """Return a number; NaN for None and infinity."""
    return float(value) if value is not None and math.isfinite(value) else math.nan


def _resolve_motion(
    target: OffboardSetpoint,
    position: Array,
    velocity: Array,
    acceleration: Array,
    attitude: Array,
) -> ResolvedSetpoint | str:
    if target.frame == "body":
        heading = yaw_of(attitude)
        position = _NONE
        velocity = _turned(velocity, heading)
        acceleration = _turned(acceleration, heading)
    elif target.frame != "map":
        return f"coordinate frame {target.frame} unsupported"
    commanded = [np.isfinite(axes) for axes in (position, velocity, acceleration)]
    if not (commanded[0] | commanded[1] | commanded[2]).all():
        return "invalid set point: an axis is not commanded"
    if any(axes[0] != axes[1] for axes in commanded):
        return "invalid set point: x and y differ in what is commanded"
    kind = ControlLevel.ACCELERATION
    if commanded[0].any():
        kind = ControlLevel.POSITION
    elif commanded[1].any():
        kind = ControlLevel.VELOCITY
    yaw, yaw_rate = finite_or_nan(target.yaw), finite_or_nan(target.yaw_rate)
    if abs(yaw) > _LARGEST or abs(yaw_rate) > _FASTEST:
        return "set point is out of range"
    return ResolvedSetpoint(kind, position, velocity, acceleration, yaw, yaw_rate)


def _resolve_attitude(target: OffboardSetpoint) -> ResolvedSetpoint | str:
    thrust = finite_or_nan(target.thrust)
    rates = _axes(target.rates)
    if rates is None:
        return "set point has a wrong shape"
    if _most(rates) > _FASTEST:
        return "set point is out of range"
    kind, attitude = ControlLevel.RATES, _LEVEL
    if target.attitude is None:
        if not np.isfinite(rates).any():
            return "set point commands nothing"
    else:
        kind, attitude = ControlLevel.ATTITUDE, np.array(target.attitude, dtype=float)
        if attitude.shape != (4,) or not np.isfinite(attitude).all():
            return "invalid set point: attitude is not finite"
        length = float(np.linalg.norm(attitude))
        if not 0.5 < length < 2.0:
            return "invalid set point: attitude is no unit quaternion"
        attitude = attitude / length
    if not math.isfinite(thrust):
        return "invalid set point: no thrust"
    rates, thrust = np.nan_to_num(rates), min(max(thrust, 0.0), 1.0)
    return ResolvedSetpoint(kind, attitude=attitude, rates=rates, thrust=thrust)


def _turned(v: Array, yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])
