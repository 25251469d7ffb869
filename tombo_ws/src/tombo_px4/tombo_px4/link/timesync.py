"""Offset between two clocks from TIMESYNC round trips, in both directions.

A request carries its sender's time `ts1`; the answer brings it back with the other's time `tc1`.
What we know then, without any model of the way: the answer was written between the request's
departure and the answer's arrival, so the offset lies within half a round trip of

    (ts1 + arrival) / 2 - tc1

How likely it is near the edge depends on how much longer than the quickest round trip it took: all
of it may have been spent in one direction. That excess is the standard deviation in a Kalman
filter of one state; the bound catches what the model does not know, as a clock that runs some
percent faster.
"""

from __future__ import annotations

from collections import deque


def answer_request(ts1: int, received_ns: int, now_ns: int) -> tuple[int, int]:
    """Return (tc1, ts1) that answer a request with the time `ts1`.

    The time in it is the middle between arrival and departure of the answer, so that a request
    that has waited for us biases nothing.
    """
    return (received_ns + now_ns) // 2, ts1


CONVERGED = 10
"""Answers after which stamps may be converted."""

_PENDING = 32
"""Requests that may be under way; at 10 Hz, for 3 s."""
_QUICKEST_OF = 32
_SLOW_NS = 10_000_000
"""An answer this much slower than the quickest round trip is ignored."""
_PATIENCE = 10
_JUMP_NS = 5_000_000
_PROOFS = 3
_NOISE_NS = 50_000.0
_WANDER_NS2_PER_S = 6.25e7
"""A clock's own wandering: with it the filter follows within about 2 s at 10 Hz."""
_LONGEST_S = 10.0


class TimeSync:
    """Offset between the other side's clock and ours, from TIMESYNC round trips.

    Attributes:
        offset_ns: theirs + offset = ours; None before the first answer.
        rtt_ns: of the last answer that counted; None before.
        jumps: how often one of the clocks jumped, and the offset was measured anew.
        converged: enough answers came for stamps to be converted; a jump does not take it back,
            because one answer bounds the new offset to half a round trip.
        refused: answers to nothing we asked, or from before the request.
        slow: answers that took too long to be worth anything.
    """

    def __init__(self) -> None:
        self.offset_ns: int | None = None
        self.rtt_ns: int | None = None
        self.jumps = 0
        self.converged = False
        self.refused = 0
        self.slow = 0
        self._pending: deque[int] = deque(maxlen=_PENDING)
        self._round_trips: deque[int] = deque(maxlen=_QUICKEST_OF)
        self._samples = 0
        self._offset = 0.0  # against self._base: floats have no room for today's time in ns
        self._base = 0
        self._variance = 0.0
        self._last_ns = 0
        self._slow_in_a_row = 0
        self._impossible = 0  # answers in a row that prove a jump

    def request(self, now_ns: int) -> tuple[int, int]:
        """Return (tc1, ts1) of a request that leaves now."""
        self._pending.append(now_ns)
        return 0, now_ns

    def reply(self, tc1: int, ts1: int, received_ns: int) -> None:
        """Take their answer to one of our requests; anything else is counted and changes nothing.

        Args:
            tc1: their time.
            ts1: ours, as we sent it.
            received_ns: when it arrived, our clock.
        """
        if tc1 <= 0 or ts1 not in self._pending or received_ns < ts1:
            self.refused += 1
            return
        self._pending.remove(ts1)
        rtt = received_ns - ts1
        sample = (ts1 + received_ns) // 2 - tc1
        if self.offset_ns is None:
            self._begin(sample, rtt, received_ns)
            return
        error = float(sample - self._base) - self._offset
        beyond = abs(error) - 0.5 * rtt
        if beyond > _JUMP_NS:
            self._impossible += 1
            if self._impossible >= _PROOFS:
                self.jumps += 1
                self._begin(sample, rtt, received_ns)
            return
        self._impossible = 0
        self._round_trips.append(rtt)
        excess = rtt - min(self._round_trips)
        if excess > _SLOW_NS and self._samples >= CONVERGED:
            self.slow += 1
            self._slow_in_a_row += 1
            if self._slow_in_a_row >= _PATIENCE:  # the way itself has become slow
                self._round_trips.clear()
            return
        self._slow_in_a_row = 0
        self._correct(error, beyond, float(excess), received_ns)
        self._samples += 1
        self.converged = self.converged or self._samples >= CONVERGED
        self.rtt_ns = rtt
        self.offset_ns = self._base + round(self._offset)

    def to_local_time(self, theirs_ns: int) -> int:
        """Convert their time to ours; unchanged before the first answer."""
        return theirs_ns + (self.offset_ns or 0)

    def _begin(self, sample: int, rtt: int, now_ns: int) -> None:
        self.offset_ns = self._base = sample
        self.rtt_ns = rtt
        self._round_trips.clear()
        self._round_trips.append(rtt)
        self._samples = 1
        self._offset = 0.0
        self._variance = (0.5 * rtt + _NOISE_NS) ** 2
        self._last_ns = now_ns
        self._slow_in_a_row = self._impossible = 0

    def _correct(self, error: float, beyond: float, excess: float, now_ns: int) -> None:
        """Take a sample that differs by `error`, `beyond` more than half its round trip [ns]."""
        passed_s = min(max(1e-9 * (now_ns - self._last_ns), 0.0), _LONGEST_S)
        self._last_ns = now_ns
        self._variance += _WANDER_NS2_PER_S * passed_s
        gain = self._variance / (self._variance + (excess + _NOISE_NS) ** 2)
        self._variance *= 1.0 - gain
        step = gain * error
        if beyond > 0.0 and abs(step) < beyond:  # at least to where it is possible
            step = beyond if error > 0.0 else -beyond
            self._variance = max(self._variance, beyond * beyond)
        self._offset += step
