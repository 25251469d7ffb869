"""Several streams of messages put into the one order in which they arrived."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Times


def merge_by_arrival(*streams: Times) -> Iterator[tuple[int, int, int]]:
    """Yield (time [ns], stream, row) of all messages; of equal times the earlier stream's first.

    Args:
        streams: log times of each stream.
    """
    times = np.concatenate(streams)
    owner = np.repeat(np.arange(len(streams)), [len(stream) for stream in streams])
    rows = np.concatenate([np.arange(len(stream)) for stream in streams])
    order = np.lexsort((owner, times))
    yield from zip(times[order].tolist(), owner[order].tolist(), rows[order].tolist(), strict=True)


def last_before(times: Times, at: Sequence[int] | Times) -> NDArray[np.intp]:
    """Return for each time the row of the newest message up to it, -1 before the first."""
    return np.searchsorted(times, np.asarray(at, np.int64), side="right") - 1
