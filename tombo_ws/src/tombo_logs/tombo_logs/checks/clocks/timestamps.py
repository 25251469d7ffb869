"""Whether stamps are the times of capture."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import sample_interval

_JITTER_S = 0.0015
_BLOCK = 60
"""Samples over which a clock's drift is negligible."""


def jitter(t: Array) -> float:
    """Return how far stamps lie off an even grid, as standard deviation [s]."""
    step = sample_interval(t)
    if t.size < 12 or step == 0.0:
        return 0.0
    off = []
    for begin in range(0, t.size - 11, _BLOCK):
        block = t[begin : begin + _BLOCK]
        if block.size < 12:
            continue
        index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(block) / step), 1))])
        line = np.polyfit(index, block - block[0], 1)
        off.append(block - block[0] - np.polyval(line, index))
    if not off:
        return 0.0
    spread = np.concatenate(off)
    # twice the inner half: a few samples that came late count for little
    return float(np.subtract(*np.percentile(spread, [84.0, 16.0])) / 2.0)


def arrival_stamps(flight: str, t: Array, arrival: Array | None) -> list[Finding]:
    """Return whether the motion capture's stamps look like times of arrival."""
    spread, step = jitter(t), sample_interval(t)
    if arrival is not None and arrival.size == t.size >= 12:
        late = arrival - t
        late = late[np.isfinite(late)]
        if late.size and np.abs(late).max() < 2e-4:
            text = (
                f"position: stamps are the times of recording to within "
                f"{1e3 * np.abs(late).max():.2g} ms; expected: times of capture, which are "
                "earlier by the latency of the motion capture"
            )
            return [Finding("stamps", "info", flight, text, channel="position")]
    if spread <= max(_JITTER_S, 0.03 * step):
        return []
    text = (
        f"position: stamps jitter by {1e3 * spread:.1f} ms about {1.0 / step:.0f} Hz, as times of "
        "arrival do; expected: times of capture, evenly spaced"
    )
    return [Finding("stamps", "warning", flight, text, channel="position")]
