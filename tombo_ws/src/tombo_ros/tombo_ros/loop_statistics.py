"""Timing statistics of a loop: rate, lateness, missed deadlines. Pure, without a clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_BINS = 20_000
"""One for each microsecond; what is later than 20 ms falls into the last."""


@dataclass(frozen=True)
class LoopMetrics:
    """Timing of a loop since its start."""

    runs: int
    missed: int
    """Deadlines that passed without a run."""
    rate_hz: float
    jitter_p50_us: float
    jitter_p99_us: float
    jitter_max_us: float

    def as_values(self) -> dict[str, float | int]:
        """Return the figures under the keys of `/diagnostics`."""
        return {
            "rate_hz": round(self.rate_hz, 3),
            "jitter_p50_us": self.jitter_p50_us,
            "jitter_p99_us": self.jitter_p99_us,
            "jitter_max_us": round(self.jitter_max_us, 1),
            "runs": self.runs,
            "missed": self.missed,
        }


class LatenessHistogram:
    """Counts durations by the microsecond; percentiles of all there were."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.largest_us = 0.0
        self.number = 0

    def add(self, duration_ns: int) -> None:
        """Count a duration; what is below 0 counts as 0."""
        micro = duration_ns * 1e-3
        if micro > self.largest_us:
            self.largest_us = micro
        self._counts[min(max(int(micro), 0), _BINS - 1)] += 1
        self.number += 1

    def percentile_us(self, share: float) -> float:
        """Return the duration that a share (0..1) of all does not exceed [us]; 0 without any."""
        if not self.number:
            return 0.0
        return float(np.searchsorted(np.cumsum(self._counts), share * self.number))


class LoopStatistics:
    """Watches the runs of one loop."""

    def __init__(self) -> None:
        self._lateness = LatenessHistogram()
        self._first_ns = 0
        self._last_ns = 0
        self.missed = 0

    def ran(self, now_ns: int, late_ns: int, missed: int = 0) -> None:
        """Count a run, `late_ns` after its deadline, with `missed` deadlines before it."""
        if not self._lateness.number:
            self._first_ns = now_ns
        self._last_ns = now_ns
        self._lateness.add(late_ns)
        self.missed += missed

    def metrics(self) -> LoopMetrics:
        """Return the metrics so far."""
        runs = self._lateness.number
        span = self._last_ns - self._first_ns
        return LoopMetrics(
            runs,
            self.missed,
            (runs - 1) * 1e9 / span if span > 0 else 0.0,
            self._lateness.percentile_us(0.5),
            self._lateness.percentile_us(0.99),
            self._lateness.largest_us,
        )
