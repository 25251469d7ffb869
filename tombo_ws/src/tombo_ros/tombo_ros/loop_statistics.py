"""Timing statistics of a loop: rate, lateness, missed deadlines. Pure, without a clock."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.time_base import LATENESS_MAX_US

_BINS = round(LATENESS_MAX_US) + 1
"""One for each microsecond; later values fall into the last."""


class LatenessHistogram:
    """Counts durations by the microsecond; percentiles of all there were."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.largest_us = 0.0
        self.number = 0

    def add(self, duration_ns: int) -> None:
        """Count a duration; values below 0 count as 0."""
        micro = duration_ns * 1e-3
        if micro > self.largest_us:
            self.largest_us = micro
        self._counts[min(max(int(micro), 0), _BINS - 1)] += 1
        self.number += 1

    def percentile_us(self, share: float) -> float:
        """Return the duration that a share (0..1) of all does not exceed [us]; 0 without any.

        `LATENESS_MAX_US`: it is that or more.
        """
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

    def metrics(self) -> dict[str, float | int]:
        """Return the figures since the start, under the keys of `/diagnostics`.

        `missed` are deadlines that passed without a run; `jitter_` is how late a run began.
        """
        lateness, span = self._lateness, self._last_ns - self._first_ns
        rate_hz = (lateness.number - 1) * 1e9 / span if span > 0 else 0.0
        return {
            "rate_hz": round(rate_hz, 3),
            "jitter_p50_us": lateness.percentile_us(0.5),
            "jitter_p99_us": lateness.percentile_us(0.99),
            "jitter_max_us": round(lateness.largest_us, 1),
            "runs": lateness.number,
            "missed": self.missed,
        }
