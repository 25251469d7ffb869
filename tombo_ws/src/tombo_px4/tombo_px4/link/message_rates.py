"""Rates of received messages."""

from __future__ import annotations

from collections import deque

_WINDOW_NS = 2_000_000_000


class MessageRates:
    """Counts arrivals within the last two seconds."""

    def __init__(self) -> None:
        self._times: dict[str, deque[int]] = {}

    def count(self, name: str, time_ns: int) -> None:
        """Count one."""
        times = self._times.setdefault(name, deque(maxlen=1000))
        times.append(time_ns)

    def rate_hz(self, name: str, now_ns: int) -> float:
        """Return how often it came per second, lately."""
        times = self._times.get(name)
        if not times:
            return 0.0
        while times and now_ns - times[0] > _WINDOW_NS:
            times.popleft()
        return len(times) / (_WINDOW_NS * 1e-9)

    def rates(self, now_ns: int) -> dict[str, float]:
        """Return all rates [Hz]."""
        return {name: self.rate_hz(name, now_ns) for name in sorted(self._times)}

    def clear(self) -> None:
        """Forget all."""
        self._times.clear()
