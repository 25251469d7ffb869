"""Excluded spans of flights: transients, and where an effect's memory is lost.

Transients: short disturbances (a touch, a knock, a jump of the poses) that no effect describes.

A ground contact of 0.1 s leaves a remainder above the noise. The verdict of the whole flight would
be unknown. Transients are found in the remainder of the best explanation; they are excluded and
reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

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


@dataclass(frozen=True)
class Transient:
    """A moment of one flight."""

    flight: int
    name: str
    """Of the flight."""
    start_s: float
    end_s: float
    channel: str
    """That shows it most."""
    times_noise: float


def find_transients(problem: FlightProblem, fit: Fit) -> list[Transient]:
    """Return the moments at which a fit leaves far more than at all other times."""
    transients: list[Transient] = []
    for f, track in enumerate(problem.tracks):
        of_flight = _of_flight(problem, fit, f)
        lasted = sum(event.end_s - event.start_s for event in of_flight)
        if len(of_flight) > _MOMENTS or lasted > _SHARE * track.used_s:
            return []
        transients += of_flight
    return transients


def _of_flight(problem: FlightProblem, fit: Fit, flight: int) -> list[Transient]:
    moments: list[tuple[float, float, str]] = []
    for group, rows in problem.residual(fit, flight).items():
        if group == "pose":
            continue
        times = problem.tracks[flight].times(group)
        off = np.abs(rows - np.median(rows, axis=0))
        ratio = off / np.maximum(_NORMAL * np.median(off, axis=0), 1e-12)
        channels = problem.channels[flight][group]
        for k, j in zip(*np.nonzero(ratio > _BURST), strict=True):
            moments.append((float(times[k]), float(ratio[k, j]), channels[j].name))
    moments.sort()
    flight_name = problem.tracks[flight].name
    events: list[Transient] = []
    for t, ratio_, name in moments:
        last = events[-1] if events else None
        if last is not None and t - last.end_s < _APART_S:
            most, channel = max(
                (last.times_noise, last.channel), (ratio_, name), key=itemgetter(0)
            )
            events[-1] = replace(last, end_s=t + _AROUND_S, channel=channel, times_noise=most)
        else:
            events.append(
                Transient(flight, flight_name, t - _AROUND_S, t + _AROUND_S, name, ratio_)
            )
    return events


@dataclass(frozen=True)
class LostMemory:
    """The rest of a flight, in which the poses don't show an effect with a memory."""

    flight: int
    name: str
    """Of the flight."""
    start_s: float
    end_s: float
    effect: str


def lost_memories(problem: FlightProblem) -> list[LostMemory]:
    """Return where effects with a memory can't be followed."""
    return [
        LostMemory(f, problem.tracks[f].name, start, float(problem.tracks[f].t[-1]), effect)
        for f, linear in enumerate(problem.linears)
        for effect, start in linear.lost.items()
    ]


def exclude_spans(
    tracks: Sequence[Track], events: Sequence[Transient | LostMemory]
) -> list[Track]:
    """Return the flights without these spans, those with nearly nothing left not at all."""
    result = []
    for f, track in enumerate(tracks):
        spans = [(e.start_s, e.end_s) for e in events if e.flight == f]
        invalid = inside(track.t, spans)
        counted = np.interp(track.pose_t, track.t, invalid.astype(np.float64)) < 0.5
        fast, slow = clear_rows(track.fast, invalid), clear_rows(track.slow, invalid)
        left = track.only(fast, slow, counted) if spans else track
        if left.used_s >= SHORTEST_S:
            result.append(left)
    return result


def excluded_findings(events: Sequence[Transient | LostMemory]) -> list[Finding]:
    """Report what was excluded."""
    findings = []
    for event in events:
        name, span = event.name, (event.start_s, event.end_s)
        if isinstance(event, LostMemory):
            words = event.effect.replace("_", " ")
            text = (
                f"from {event.start_s:.1f} s on the noise of the poses decides what a {words} "
                "does: set apart"
            )
            findings.append(Finding("memory", "warning", name, text, *span))
            continue
        text = (
            f"something acts for a moment that no cause explains ({event.channel}: "
            f"{event.times_noise:.0f} times the noise), as in a touch or a knock: set apart"
        )
        findings.append(Finding("moment", "fault", name, text, *span, event.channel))
    return findings
