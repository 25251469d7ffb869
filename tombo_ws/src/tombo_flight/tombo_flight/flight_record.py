"""The record of a flight, which files, plots, reports and tests read."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tombo_dynamics.arrays import Array


@dataclass(frozen=True)
class FlightRecord:
    """A flight, tick by tick. World `map` ENU, body `base_link` FLU, SI units."""

    t: Array
    """(N,) time of each tick [s], from 0 in steps of 1 ms."""
    log: dict[str, Array]
    """Name -> (N, k): columns of `tombo_sim.log_columns`."""
    mocap_t: Array
    """(M,) capture times of the samples that arrived [s]."""
    mocap_arrival: Array
    """(M,) their times of arrival [s]."""
    mocap_position: Array
    """(M, 3) as measured [m]."""
    mocap_attitude: Array
    """(M, 4) as measured, xyzw."""
    detector_statistic: Array
    """(M,) normalised innovation squared that the detector saw."""
    events: list[dict[str, Any]]
    """What happened: time_s, kind, text and more, in order of time."""
    scenario: dict[str, Any]
    """The scenario as flown, including what the seed drew."""
    summary: dict[str, Any] = field(default_factory=dict)
    """The figures of `summary.json`."""
    epoch_ns: int = 0
    """Of a recording: stamp of the tick at t = 0."""
    published: dict[str, Any] = field(default_factory=dict)
    """Of a headless flight: topic → ticks and messages of the cores."""
