"""Excluded spans of flights: transients, and where an effect's memory is lost.

Transients: short disturbances (a touch, a knock, a jump of the poses) that no effect describes.

A ground contact of 0.1 s leaves a remainder above the noise. The verdict of the whole flight would
be unknown. Transients are found in the remainder of the best explanation; they are excluded and
reported.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from tombo_bag.flight import Finding
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import SHORTEST_S, Track, clear_rows
from tombo_logs.checks.spans import inside

_BURST = 12.0
"""Robust deviations of a channel: neither noise nor a fitted effect reaches that."""
_AROUND_S = 0.3
_APART_S = 0.5
_MOMENTS = 3
_SHARE = 0.1
"""Of a flight. More frequent or longer spans are an unknown cause, not transients."""
_NORMAL = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""


def find_transients(problem: FlightProblem, fit: Fit) -> list[list[Finding]]:
    """Return each flight's moments at which a fit leaves far more than at all other times.

    Empty if a flight has none or too many.
    """
    moments = [_moments(problem, fit, f) for f in range(len(problem.tracks))]
    for track, events in zip(problem.tracks, moments, strict=True):
        lasted = sum(each.end_s - each.start_s for each in events)
        if len(events) > _MOMENTS or lasted > _SHARE * track.used_s:
            return []
    return moments if any(moments) else []


def _moments(problem: FlightProblem, fit: Fit, flight: int) -> list[Finding]:
    track = problem.tracks[flight]
    samples: list[tuple[float, float, str]] = []
    for group, rows in problem.residual(fit, flight).items():
        if group == "pose":
            continue
        times = track.times(group)
        off = np.abs(rows - np.median(rows, axis=0))
        ratio = off / np.maximum(_NORMAL * np.median(off, axis=0), 1e-12)
        channels = problem.channels[flight][group]
        for k, j in zip(*np.nonzero(ratio > _BURST), strict=True):
            samples.append((float(times[k]), float(ratio[k, j]), channels[j].name))
    samples.sort()
    moments: list[list[tuple[float, float, str]]] = []
    for sample in samples:
        if moments and sample[0] - moments[-1][-1][0] < _AROUND_S + _APART_S:
            moments[-1].append(sample)
        else:
            moments.append([sample])
    findings = []
    for moment in moments:
        _, ratio, channel = max(moment, key=lambda sample: sample[1])
        text = (
            f"something acts for a moment that no cause explains ({channel}: {ratio:.0f} times "
            "the noise), as in a touch or a knock: set apart"
        )
        span = moment[0][0] - _AROUND_S, moment[-1][0] + _AROUND_S
        findings.append(Finding("moment", "fault", track.name, text, *span, channel))
    return findings


def lost_memories(problem: FlightProblem, effects: Collection[str]) -> list[list[Finding]]:
    """Return each flight's rest, in which the poses don't show what some effects do.

    Empty if all of these effects can be followed.
    """
    lost = [
        [
            Finding(
                "memory", "warning", track.name,
                f"from {start:.1f} s on the noise of the poses decides what a "
                f"{effect.replace('_', ' ')} does: set apart",
                start, float(track.t[-1]),
            )
            for effect, start in linear.lost.items()
            if effect in effects
        ]
        for track, linear in zip(problem.tracks, problem.linears, strict=True)
    ]  # fmt: skip
    return lost if any(lost) else []


def exclude_spans(tracks: Sequence[Track], excluded: Sequence[Sequence[Finding]]) -> list[Track]:
    """Return the flights without each one's spans; none of which nearly nothing is left."""
    result = []
    for track, findings in zip(tracks, excluded, strict=True):
        invalid = inside(track.t, [(each.start_s, each.end_s) for each in findings])
        counted = np.interp(track.pose_t, track.t, invalid.astype(np.float64)) < 0.5
        fast, slow = clear_rows(track.fast, invalid), clear_rows(track.slow, invalid)
        left = track.only(fast, slow, counted) if findings else track
        if left.used_s >= SHORTEST_S:
            result.append(left)
    return result
