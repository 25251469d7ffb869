"""Which axis of the motion capture points up, told from the flight itself.

A quadrotor can push only along its own up axis, so acceleration plus gravity lies along it, and
tilt tells where it goes. Motive's own axes have y up; read as z up such a flight goes sideways
with no tilt to explain it.
"""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import body_to_map
from tombo_dynamics.vehicle import GRAVITY

_STEP_S = 0.2
"""Poses are averaged over this time, and accelerations taken from three such means."""
_LEAST_SAMPLES = 40
_CLIMB_M = 0.3
_USUAL = 0.85
"""Share of the accelerations that is looked at; the rest are strikes."""
_CLEARER = 1.7
_MOVING = 0.15
"""m/s^2: below, the vehicle has hardly moved and tilt tells nothing."""
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def find_up_axis(time_s: Array, position: Array, attitude: Array) -> list[str]:
    """Return a finding if another axis than z points up, or base_link hangs upside down.

    Args:
        time_s: (N,) capture times.
        position: (N, 3) [m].
        attitude: (N, 4) unit quaternions xyzw.
    """
    upright = body_to_map(attitude, np.array(_AXES["z"]))[:, 2]
    if np.median(upright) < 0.0:
        return ["base_link z points down: attitudes of a z-down body (NED, FRD)?"]
    climbs = [axis for i, axis in enumerate("xyz") if _climbs(position[:, i])]
    misfit = _misfits(time_s, position, attitude)
    if "z" in climbs:
        return []
    if not climbs:
        return _from_tilt_alone(misfit)
    axis = climbs[0] if misfit is None else min(climbs, key=lambda name: misfit[name])
    where = f"axis {axis} looks like up: the flight begins and ends lowest on {axis}, not on z"
    if misfit is not None and misfit[axis] > misfit["z"] / _CLEARER:
        return [f"{where}; but tilt does not agree: position and attitude in different axes?"]
    agrees = "" if misfit is None else ", and tilt agrees"
    motive = " (OptiTrack Motive: set the streamed up axis to Z)"
    return [where + agrees + motive]


def _from_tilt_alone(misfit: dict[str, float] | None) -> list[str]:
    """Return a finding for a flight that neither begins nor ends on the ground."""
    if misfit is None:
        return []
    axis = min(misfit, key=lambda name: misfit[name])
    if axis == "z" or misfit["z"] < max(_CLEARER * misfit[axis], _MOVING):
        return []
    return [f"axis {axis} looks like up: only so does tilt agree with the accelerations"]


def _climbs(height: Array) -> bool:
    """Tell whether a flight begins and ends where it is lowest, and is far above most of it."""
    low, high = float(height.min()), float(height.max())
    climb = high - low
    ends = max(float(height[0]), float(height[-1]))
    return (
        climb > _CLIMB_M
        and ends - low < 0.15 * climb
        and float(np.median(height)) > (low + 0.3 * climb)
    )


def _misfits(time_s: Array, position: Array, attitude: Array) -> dict[str, float] | None:
    """Return for each axis as up: usual acceleration across the body's up axis."""
    count = int((time_s[-1] - time_s[0]) / _STEP_S)
    if count < _LEAST_SAMPLES:
        return None
    slot = np.clip(((time_s - time_s[0]) / _STEP_S).astype(np.int64), 0, count - 1)
    filled = np.bincount(slot, minlength=count)
    if (filled == 0).mean() > 0.2:
        return None

    def means(values: Array) -> Array:
        sums = [np.bincount(slot, values[:, i], count) for i in range(values.shape[1])]
        with np.errstate(invalid="ignore"):
            return np.stack(sums, axis=1) / filled[:, None]

    where = means(position)
    acceleration = (where[2:] - 2.0 * where[1:-1] + where[:-2]) / _STEP_S**2
    found: dict[str, float] = {}
    for name, axis in _AXES.items():
        up = np.array(axis)
        body_up = means(body_to_map(attitude, up))[1:-1]
        force = acceleration + GRAVITY * up
        across = force - np.sum(force * body_up, axis=1)[:, None] * body_up
        size = np.linalg.norm(across, axis=1)
        size = size[np.isfinite(size)]
        if not len(size):
            return None
        found[name] = float(np.quantile(size, _USUAL))
    return found
