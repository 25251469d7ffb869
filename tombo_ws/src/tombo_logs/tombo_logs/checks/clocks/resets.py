"""Clocks that were set back while they were logged."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Series
from tombo_logs.checks.spans import sample_interval

_RESET_S = 0.5
"""Stamps that go back by more are a clock that was set, not messages out of order."""
_STEPS = 4.0
"""Usual steps by which a clock is set back at least."""
_DOUBLE = 1.5
"""Where a clock was set back there are twice as many samples as usual, and more than this."""


def resets(series: Series) -> list[int]:
    """Return the samples before which the clock was set back.

    Messages out of order go back, too, but fill a gap; a message that is logged again has the
    same value as before.
    """
    t = series.t
    step = sample_interval(t)
    found = []
    for i in np.flatnonzero(np.diff(t) < 0.0).tolist():
        back = float(t[i] - t[i + 1])
        if back > _RESET_S or (back > _STEPS * step > 0.0 and _twice(series, i, back / step)):
            found.append(i + 1)
    return found


def _twice(series: Series, last: int, usual: float) -> bool:
    """Return whether the times that come again were sampled again, with other values."""
    t = series.t
    low, high = t[last + 1], t[last]
    begin = max(last - round(3.0 * usual), 0)
    first = begin + np.flatnonzero((t[begin : last + 1] >= low) & (t[begin : last + 1] <= high))
    after = t[last + 1 : last + 2 + round(3.0 * usual)]
    again = last + 1 + np.flatnonzero((after >= low) & (after <= high))
    if min(first.size, again.size) < 3 or first.size + again.size < _DOUBLE * usual:
        return False
    at = np.column_stack([np.interp(t[again], t[first], c) for c in series.values[first].T])
    return bool(np.mean((at == series.values[again]).all(axis=1)) < 0.5)
