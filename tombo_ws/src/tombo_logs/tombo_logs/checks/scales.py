"""Scale and offset of each axis: gyro and accelerometer against poses, rotors against each other.

Both sides of a comparison are noisy. The slope of one on the other and the inverse of the slope
the other way round bracket the ratio of the two (Frisch, 1934): a ratio is only reported where 1
is outside of that bracket.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_logs.checks.even_flight import INDEPENDENT, EvenFlight
from tombo_logs.checks.spans import Mask, interpolated

_SIGMAS = 3.0
_FEWEST = 100
"""Commands that are compared at least."""
_TOGETHER = 0.6
"""Correlation from which on two signals are the same quantity."""
_TURNS, _ACCELERATES = 0.04, 0.3
"""rad/s and m/s^2: standard deviation of an axis that is compared."""
_GYRO_SCALE, _TRACK_SCALE = 1.15, 1.2
"""Ratio, or its inverse, that is reported. Smoothing of poses, drag of the vehicle and the time
between both streams change it by less."""
_GYRO_OFFSET = 0.06
"""rad/s that is reported."""
_ACROSS_OFFSET, _ALONG_OFFSET = 0.6, 0.5
"""m/s^2 across and along the thrust: markers may define a body that is turned by 3.5 deg."""
_UNITS = {"gyro": "rad/s", "accel": "m/s^2"}
_MAYBE = {"gyro": "", "accel": ": an offset, a scale, or a rigid body that was defined turned"}
"""Channel → causes that its offset may have."""
_ROTOR_SCALE = 1.18
"""Ratio of one rotor's command to the mean of the others: a centre of gravity off the middle, and
the scatter of small motors, stay within."""


def gyro_scales(flight: str, motion: EvenFlight, late_s: float) -> list[Finding]:
    """Report axes of the gyro that read another rate than the attitude has.

    Args:
        flight: name.
        motion: of poses and IMU.
        late_s: delay of the poses' stamps against the gyro's.
    """
    if not motion.has(motion.gyro):
        return []
    rates = interpolated(motion.t + late_s, motion.t, motion.rates)[motion.valid]
    gyro = motion.gyro[motion.valid]
    scales = _scales(flight, "gyro", rates, gyro, (_TURNS, _GYRO_SCALE), "the attitude's rate")
    return [*scales, *_offsets(flight, "gyro", rates, gyro, [_GYRO_OFFSET] * 3)]


def accel_offsets(flight: str, motion: EvenFlight) -> list[Finding]:
    """Report axes of the accelerometer that on average read another force than the poses give."""
    if not motion.has(motion.accel):
        return []
    good, limits = motion.valid, [_ACROSS_OFFSET, _ACROSS_OFFSET, _ALONG_OFFSET]
    return _offsets(flight, "accel", motion.force[good], motion.accel[good], limits)


def track_scales(flight: str, motion: EvenFlight) -> list[Finding]:
    """Report axes of the map along which the track accelerates otherwise than the IMU says."""
    if not motion.has(motion.accel):
        return []
    good = motion.valid
    what = "the accelerometer's, turned by the attitude"
    limits = _ACCELERATES, _TRACK_SCALE
    track = motion.acceleration[good]
    return _scales(flight, "position", motion.felt[good], track, limits, what)


def rotor_scales(flight: str, channel: str, command: Series, flying: Mask) -> list[Finding]:
    """Report a rotor that is asked for much more or less than the others."""
    values = command.values[flying]
    if len(values) < _FEWEST or channel == "rotor_speed":
        return []
    if channel == "rotor_command":
        values = values**2
    usual = np.maximum(np.median(values, axis=0), 1e-9)
    ratio = np.array([usual[k] / np.delete(usual, k).mean() for k in range(4)])
    k = int(np.argmax(np.abs(np.log(ratio))))
    if not _is_beyond((float(ratio[k]), float(ratio[k])), _ROTOR_SCALE):
        return []
    text = (
        f"{channel}: {ROTOR_NAMES[k]} is asked for {ratio[k]:.2f} times the others' thrust; "
        "expected: about 1; the scale of its column, another propeller or motor there, or weight "
        "beside the centre"
    )
    return [Finding("scale", "warning", flight, text, channel=channel)]


def _ratio(expected: Array, found: Array, least: float) -> tuple[float, float] | None:
    """Return the lowest and the highest ratio of `found` to `expected`, both (N,).

    None: they are not the same quantity, or change by less than `least`.
    """
    x, y = expected - expected.mean(), found - found.mean()
    sizes = float(x.std()), float(y.std())
    if sizes[0] < least or sizes[1] < 1e-9:
        return None
    together = float(np.mean(x * y)) / (sizes[0] * sizes[1])
    if together < _TOGETHER:
        return None
    ratio = sizes[1] / sizes[0]
    noise = np.sqrt((1.0 - together**2) * INDEPENDENT / x.size) / together
    return ratio * together * (1.0 - _SIGMAS * noise), ratio / together * (1.0 + _SIGMAS * noise)


def _is_beyond(bracket: tuple[float, float], limit: float) -> bool:
    return bracket[0] > limit or bracket[1] < 1.0 / limit


def _scales(
    flight: str, channel: str, expected: Array, measured: Array, limits: tuple[float, float],
    against: str,
) -> list[Finding]:  # fmt: skip
    """Report axes of (N, 3) whose scale differs; limits: least change, and ratio."""
    findings = []
    for k, axis in enumerate("xyz"):
        bracket = _ratio(expected[:, k], measured[:, k], limits[0])
        if bracket is not None and _is_beyond(bracket, limits[1]):
            text = (
                f"{channel}: its {axis} moves {bracket[0]:.2f} to {bracket[1]:.2f} times as much "
                f"as {against}; expected: 1, one scale for all axes"
            )
            findings.append(Finding("scale", "warning", flight, text, channel=channel))
    return findings


def _offsets(
    flight: str, channel: str, expected: Array, measured: Array, limits: Sequence[float]
) -> list[Finding]:
    """Report axes of (N, 3) that read something else throughout; limits by axis."""
    left = measured - expected
    offsets, sigmas = left.mean(axis=0), left.std(axis=0) * np.sqrt(INDEPENDENT / len(left))
    findings = []
    for axis, offset, sigma, limit in zip("xyz", offsets, sigmas, limits, strict=True):
        if abs(offset) > max(limit, _SIGMAS * sigma):
            text = (
                f"{channel}: its {axis} reads {offset:+.3f} ± {sigma:.3f} {_UNITS[channel]} "
                f"beside what the poses give{_MAYBE[channel]}; expected: 0"
            )
            findings.append(Finding("offset", "warning", flight, text, channel=channel))
    return findings
