"""Is a motion capture ready for a flight: mistakes of its set-up, and figures that a lab keeps.

Each check asks one question of the recorded poses, and of the gyro where there is one. A turned
rigid body shows against a gyro alone: poses of a body that hovers are right for any nose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Flight, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_flight.replay.poses import find_up_axis
from tombo_logs.checks.clocks.stamps import LONG_S, arrival_stamps, gap_spans
from tombo_logs.checks.even_flight import EvenFlight, poses_and_imu
from tombo_logs.checks.imu import MAX_TURN_RAD
from tombo_logs.checks.pipeline import findings_of
from tombo_logs.checks.pose_imu_consistency import alignment, time_offset
from tombo_logs.checks.samples import frozen_spans
from tombo_logs.checks.spans import runs, sample_interval, white_noise

LEAST_RATE_HZ = 30.0
"""Rate below which PX4's EKF2 and the detector are not fed as docs/px4.md asks."""
_RATE_TOLERANCE = 0.95
"""Share of that rate that still passes: a system set to 30 Hz may give 29.97."""
_LEAST_POSES = 30
"""Poses that a recording must have for the checks: a second at the lowest rate."""
_LEAST_LATENESS_S = 2e-4
"""Smallest delay of any real pose: if all are below it, arrivals were written as stamps."""
_LARGEST_VOLUME_M = 50.0
"""Size of the largest halls with motion capture; farther apart, poses are in another unit."""
_STILL_M = 0.02
"""A rigid body that stays within this is not the vehicle that flies, or it does not fly."""
_SWAPPED_RAD, _SWAPPED_RATE = np.radians(12.0), 35.0
"""rad, rad/s: between two poses; gyros end at 2000 deg/s, 35 rad/s."""
_ALIGNED = 0.7
"""Share of the gyro's variance that a turned attitude must explain."""
_AHEAD_S, _BEHIND_S = 0.03, 0.15
"""s: stamps ahead of the gyro's, or behind by more than any motion capture needs."""
_STRUCK = frozenset({"crash", "contact"})
"""Checks of a log whose spans are left out of the comparison with the gyro."""
_QUIET_S, _QUIET_M_S = 1.0, 0.02
"""s, m/s: a body that is slower for this time is at rest, and its noise is measured there."""


Mistakes = dict[str, str]
"""Name of a mistake → the observation, the expectation, and the mend."""


@dataclass(frozen=True)
class MocapQuality:
    """Mistakes and figures of recorded poses."""

    findings: Mistakes
    figures: dict[str, float | None]
    """Name with its unit → value; None: it can't be told from this recording."""


def check_mocap(log: Flight) -> MocapQuality:
    """Return mistakes and figures of a recording's poses.

    Raises:
        InputError: it has no poses, or too few.
    """
    series = log.series
    if not {"position", "attitude"} <= series.keys():
        raise InputError(f"'{log.name}' has no poses; accepted: position and attitude of a body")
    position, attitude = series["position"], series["attitude"]
    rows = np.isfinite(position.values).all(axis=1)
    if np.count_nonzero(rows) < _LEAST_POSES:
        raise InputError(
            f"'{log.name}' has {np.count_nonzero(rows)} poses; accepted: {_LEAST_POSES} or more"
        )
    motion = None
    if "gyro" in series:
        struck = [(f.start_s, f.end_s) for f in findings_of(log) if f.check in _STRUCK]
        motion = poses_and_imu(position, attitude, series["gyro"], None, struck)
    findings = _unit(position)
    if not findings:
        findings = _axes(position, attitude, motion) | _still(position)
    findings |= _swapped(attitude) | _frozen(position, attitude) | _rate(position)
    findings |= _gaps(position) | _stamps(position, motion)
    return MocapQuality(findings, _figures(position, attitude))


def _unit(position: Series) -> Mistakes:
    """Check that positions are in metres."""
    size = float(np.nanmax(np.abs(position.values)))
    if size < _LARGEST_VOLUME_M:
        return {}
    text = (
        f"positions of up to {size:.4g}; expected: metres. Set the unit of the driver or the "
        "export to metres"
    )
    return {"millimetres": text}


def _axes(position: Series, attitude: Series, motion: EvenFlight | None) -> Mistakes:
    """Check the upward axis, then the turn of the rigid body."""
    at = np.clip(np.searchsorted(attitude.t, position.t), 0, attitude.t.size - 1)
    quaternions = attitude.values[at]
    norm = np.linalg.norm(quaternions, axis=1)
    good = np.isfinite(position.values).all(axis=1) & (np.abs(norm - 1.0) < 0.1)
    if np.count_nonzero(good) < _LEAST_POSES:
        return {}
    up = find_up_axis(position.t[good], position.values[good], quaternions[good])
    if up:
        return {"up_axis": f"{up[0]}. `tombo mocap --up y_up` turns them"}
    if motion is None:
        return {}
    offset = time_offset(motion)
    turned = None if offset is None else alignment(motion, offset.lag)
    if turned is None or turned.explained < _ALIGNED or turned.angle < MAX_TURN_RAD:
        return {}
    x, y, z = np.degrees(turned.turn.as_rotvec())
    if np.linalg.norm([abs(x) - 90.0, y, z]) < np.degrees(MAX_TURN_RAD):
        text = (
            f"the attitude is turned against the gyro by {x:.0f} deg about x, as where y points "
            "up. `tombo mocap --up y_up` turns it"
        )
        return {"up_axis": text}
    text = (
        f"the rigid body is turned against the gyro by [{x:.0f}, {y:.0f}, {z:.0f}] deg about x, "
        "y, z; expected: x to the nose, z up. `tombo mocap --nose` turns it about z; else define "
        "it again with the vehicle level, its nose along the x axis"
    )
    return {"body_turned": text}


def _still(position: Series) -> Mistakes:
    """Check that the body moves; the outermost 2 % of positions may be single wrong ones."""
    size = float(np.ptp(np.nanpercentile(position.values, [2.0, 98.0], axis=0), axis=0).max())
    if size > _STILL_M:
        return {}
    text = (
        f"the rigid body stays within {1e3 * size:.1f} mm; expected: it moves with the vehicle. "
        "Is it the right one? `tombo mocap --body`"
    )
    return {"does_not_move": text}


def _swapped(attitude: Series) -> Mistakes:
    """Check for jumps of the attitude that no vehicle makes: markers were taken for each other."""
    usable = np.abs(np.linalg.norm(attitude.values, axis=1) - 1.0) < 0.1
    t, q = attitude.t[usable], attitude.values[usable]
    step = sample_interval(t)
    turn = (Rotation.from_quat(q[:-1]).inv() * Rotation.from_quat(q[1:])).magnitude()
    dt = np.diff(t)
    jumps = (turn > _SWAPPED_RAD) & (turn > _SWAPPED_RATE * dt) & (dt < 3.0 * step)
    if not jumps.any():
        return {}
    first = int(np.argmax(jumps))
    text = (
        f"the attitude jumps {np.count_nonzero(jumps)} times, first by "
        f"{np.degrees(turn[first]):.0f} deg at {t[first]:.2f} s; expected: a motion. Place the "
        "markers so that no turn of them looks the same, and no two bodies are alike"
    )
    return {"markers_swapped": text}


def _frozen(position: Series, attitude: Series) -> Mistakes:
    """Check for poses that are repeated to the bit."""
    spans = frozen_spans(position.t, position.values)
    spans = spans or frozen_spans(attitude.t, attitude.values)
    if not spans:
        return {}
    begin, end = max(spans, key=lambda span: span[1] - span[0])
    text = (
        f"the same pose {len(spans)} times, the longest {end - begin:.2f} s at {begin:.2f} s; "
        "expected: no pose while the body is not seen. Let the system send tracked bodies alone"
    )
    return {"frozen": text}


def _rate(position: Series) -> Mistakes:
    """Check that poses are frequent enough, by the usual interval of their stamps."""
    rate_hz = 1.0 / sample_interval(position.t)
    if rate_hz >= LEAST_RATE_HZ * _RATE_TOLERANCE:
        return {}
    text = (
        f"{rate_hz:.1f} poses in a second; expected: {LEAST_RATE_HZ:g} or more. Raise the rate of "
        "the system, and look for a network that loses packets"
    )
    return {"rate": text}


def _gaps(position: Series) -> Mistakes:
    """Check for times without poses."""
    spans = gap_spans(position.t)
    longest = max((end - begin for begin, end in spans), default=0.0)
    if longest <= LONG_S:
        return {}
    text = (
        f"{len(spans)} gaps, the longest {longest:.2f} s; expected: {LONG_S:g} s at most. "
        "Add or turn cameras until the whole volume is seen by three"
    )
    return {"gaps": text}


def _stamps(position: Series, motion: EvenFlight | None) -> Mistakes:
    """Check that stamps are times of capture, on the clock of the others."""
    uneven = arrival_stamps("", position.t, None)
    if uneven:
        text = (
            f"{uneven[0].message}. Stamp by the system's clock (of vrpn_mocap: "
            "use_vrpn_timestamps), or subtract a delay"
        )
        return {"arrival_stamps": text}
    late_s = _latency(position)
    offset = None
    if late_s is None and motion is not None:
        offset = time_offset(motion)
    if late_s is not None and float(np.median(late_s)) < -1e-3:
        seen = f"stamps are {-1e3 * float(np.median(late_s)):.0f} ms after their arrival"
    elif offset is not None and offset.lag > _AHEAD_S:
        seen = f"stamps are {1e3 * offset.lag:.0f} ms later than the gyro's"
    elif offset is not None and offset.lag < -_BEHIND_S:
        seen = f"stamps are {-1e3 * offset.lag:.0f} ms earlier than the gyro's"
    else:
        return {}
    text = (
        f"{seen}; expected: the time of capture, on the clock of this computer. Let both "
        "computers follow one clock (chrony), or stamp the arrival and subtract a delay"
    )
    return {"clock": text}


def _latency(position: Series) -> Array | None:
    """Return arrival minus stamp of each pose [s] (N,), without NaN.

    None if arrivals are not known, or equal the stamps: one was then copied from the other.
    """
    if position.arrival is None or position.arrival.size != position.t.size:
        return None
    late: Array = position.arrival - position.t
    late = late[np.isfinite(late)]
    return late if late.size and np.abs(late).max() > _LEAST_LATENESS_S else None


def _figures(position: Series, attitude: Series) -> dict[str, float | None]:
    """Return the figures of `MocapQuality`; the noise is that of three axes together."""
    t, values = position.t, position.values
    spans = gap_spans(t)
    late_s = _latency(position)
    at_rest = _rest(position)

    def late(percent: float) -> float | None:
        return None if late_s is None else 1e3 * float(np.percentile(late_s, percent))

    def noise(quantity: Callable[[], Array], scale: float) -> float | None:
        return None if at_rest is None else scale * float(np.linalg.norm(quantity()))

    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    return {
        "duration_s": float(t[-1] - t[0]),
        "rate_hz": 1.0 / sample_interval(t),
        "latency_p50_ms": late(50.0),
        "latency_p99_ms": late(99.0),
        "noise_position_mm": noise(lambda: white_noise(values[at_rest]), 1e3),
        "noise_attitude_deg": noise(
            # the vector part of a quaternion is half a turn, where it is small
            lambda: 2.0 * white_noise(_samples_after(attitude, t[at_rest])[:, :3]),
            np.degrees(1.0),
        ),
        "dropouts": float(len(spans)),
        "longest_gap_s": max((end - begin for begin, end in spans), default=0.0),
        **{f"{axis}_min_m": float(low[i]) for i, axis in enumerate("xyz")},
        **{f"{axis}_max_m": float(high[i]) for i, axis in enumerate("xyz")},
    }


def _samples_after(series: Series, times: Array) -> Array:
    """Return the values at the samples after these times."""
    return series.values[np.clip(np.searchsorted(series.t, times), 0, series.t.size - 1)]


def _rest(position: Series) -> slice | None:
    """Return the rows of the longest rest; None: the body is nowhere at rest for a second."""
    window = max(round(0.25 / sample_interval(position.t)), 2)
    moved = np.full(position.t.size, np.inf)
    steps = position.values[window:] - position.values[:-window]
    moved[:-window] = np.linalg.norm(steps, axis=1)
    elapsed = position.t[window:] - position.t[:-window]
    still = moved < _QUIET_M_S * np.concatenate([elapsed, np.full(window, 0.0)])
    spans = [(i, j) for i, j in runs(still) if position.t[j] - position.t[i] >= _QUIET_S]
    if not spans:
        return None
    begin, end = max(spans, key=lambda span: span[1] - span[0])
    return slice(begin, end)
