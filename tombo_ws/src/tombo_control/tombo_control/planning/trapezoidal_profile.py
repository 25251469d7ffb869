"""The reference between two points: accelerate, cruise, decelerate along a straight line."""

from __future__ import annotations

from tombo_dynamics.jit import compiled


@compiled
def trapezoidal_profile(since: float, duration: float, ramp: float) -> tuple[float, float, float]:
    """Return way, speed and acceleration along a leg, each divided by the cruise speed.

    Speed rises linearly from 0 to 1 within `ramp`, stays, and falls to 0 within the last `ramp`.

    Args:
        since: time since the leg's begin [s]; before 0 and after `duration` it stands still.
        duration: length of the leg in time [s], at least twice the ramp.
        ramp: time to reach cruise speed [s]; 0 starts and stops at once.

    Returns:
        way [s], speed [1], acceleration [1/s].
    """
    t = min(max(since, 0.0), duration)
    if t < ramp:
        return 0.5 * t * t / ramp, t / ramp, 1.0 / ramp if since >= 0.0 else 0.0
    if t <= duration - ramp and since < duration:
        return t - 0.5 * ramp, 1.0 if since >= 0.0 else 0.0, 0.0
    left = duration - t
    if left <= 0.0:
        return duration - ramp, 0.0, 0.0
    return duration - ramp - 0.5 * left * left / ramp, left / ramp, -1.0 / ramp
