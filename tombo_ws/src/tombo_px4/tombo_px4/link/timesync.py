"""Offset between two clocks from TIMESYNC round trips, in both directions.

A request carries its sender's time `ts1`; the answer brings it back with the other's time `tc1`.
What we know then, without any model of the way: the answer was written between the request's
departure and the answer's arrival, so the offset lies within half a round trip of

    (ts1 + arrival) / 2 - tc1

How likely it is near the edge depends on how much longer than the quickest round trip it took: so
much may have been spent in one direction alone. That excess is the standard deviation in a Kalman
filter of one state; the bound catches what the model does not know.

The clock of a simulated vehicle may run slower or faster than time by whole percents. That the
bound is left again and again to the same side proves it; only then is a rate used.
"""

from __future__ import annotations

from collections import deque

from tombo_dynamics.time_base import SECOND_NS

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
_DRIFT_PROOF_NS = 200_000.0
"""Left by more than this, three times in a row to one side: the clocks run at different rates."""
_FASTEST = 0.9
_DRIFT_DECAY, _SMALL_DRIFT, _NO_DRIFT = 0.98, 5e-3, 1e-5
_AHEAD_NS = SECOND_NS
"""Without an answer a rate is used for no longer than this."""


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
        self._impossible: list[tuple[int, int, int]] = []  # arrival, sample, round trip
        self._drift = 0.0  # of the offset, per time of ours
        self._drift_votes = 0  # how often in a row the bound was left; negative: downwards

    def request(self, now_ns: int) -> tuple[int, int]:
        """Return (tc1, ts1) of a request that leaves now."""
        self._pending.append(now_ns)
        return 0, now_ns

    def answer(self, tc1: int, ts1: int, received_ns: int, now_ns: int) -> tuple[int, int] | None:
        """Return (tc1, ts1) that answer their request; None if it is none.

        Args:
            tc1: as received; 0 in a request.
            ts1: as received.
            received_ns: when it arrived, our clock.
            now_ns: when the answer leaves. The time in it is the middle between the two, so that
                a request that has waited for us biases nothing.
        """
        if tc1 != 0:
            return None
        return (received_ns + now_ns) // 2, ts1

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
        error = float(sample - self._base) - self._offset - self._drifted(received_ns)
        beyond = abs(error) - 0.5 * rtt
        if beyond > _JUMP_NS:
            self._impossible.append((received_ns, sample, rtt))
            if len(self._impossible) >= _PROOFS:
                self.jumps += 1
                drift = _slope(self._impossible)
                self._begin(sample, rtt, received_ns)
                self._drift = drift
            return
        self._impossible.clear()
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
        ours_ns = theirs_ns + (self.offset_ns or 0)
        return ours_ns + round(self._drifted(ours_ns) / (1.0 - self._drift))

    def _drifted(self, ours_ns: int) -> float:
        """Return by how much the offset has changed since the last answer that counted [ns]."""
        if self._drift == 0.0:
            return 0.0
        return self._drift * min(max(ours_ns - self._last_ns, -_AHEAD_NS), _AHEAD_NS)

    def _begin(self, sample: int, rtt: int, now_ns: int) -> None:
        self.offset_ns = self._base = sample
        self.rtt_ns = rtt
        self._round_trips.clear()
        self._round_trips.append(rtt)
        self._samples = 1
        self._offset = 0.0
        self._variance = (0.5 * rtt + _NOISE_NS) ** 2
        self._last_ns = now_ns
        self._slow_in_a_row = self._drift_votes = 0
        self._impossible.clear()
        self._drift = 0.0

    def _correct(self, error: float, beyond: float, excess: float, now_ns: int) -> None:
        """Take a sample that differs by `error`, `beyond` more than half its round trip [ns]."""
        passed_s = min(max(1e-9 * (now_ns - self._last_ns), 0.0), _LONGEST_S)
        self._offset += self._drifted(now_ns)
        self._learn_drift(error, beyond, passed_s)
        self._last_ns = now_ns
        self._variance += _WANDER_NS2_PER_S * passed_s
        gain = self._variance / (self._variance + (excess + _NOISE_NS) ** 2)
        self._variance *= 1.0 - gain
        step = gain * error
        if beyond > 0.0 and abs(step) < beyond:  # at least to where it is possible
            step = beyond if error > 0.0 else -beyond
            self._variance = max(self._variance, beyond * beyond)
        self._offset += step

    def _learn_drift(self, error: float, beyond: float, passed_s: float) -> None:
        """Use a rate once it is proven; drop a small one that is not proven again."""
        if beyond <= _DRIFT_PROOF_NS or passed_s <= 0.0:
            self._drift_votes = 0
            if abs(self._drift) < _SMALL_DRIFT:
                self._drift = self._drift * _DRIFT_DECAY if abs(self._drift) > _NO_DRIFT else 0.0
            return
        side = 1 if error > 0.0 else -1
        self._drift_votes = self._drift_votes + side if self._drift_votes * side >= 0 else side
        if abs(self._drift_votes) >= _PROOFS:
            self._drift_votes = 0
            drift = self._drift + side * beyond / (SECOND_NS * passed_s)
            self._drift = min(max(drift, -_FASTEST), _FASTEST)


def _slope(samples: list[tuple[int, int, int]]) -> float:
    """Return the rate that samples (arrival, offset, round trip) [ns] prove; 0: none."""
    (begin, first, rtt), (end, last, back) = samples[0], samples[-1]
    passed, changed = end - begin, last - first
    if passed <= 0 or abs(changed) <= 0.5 * (rtt + back) + _DRIFT_PROOF_NS:
        return 0.0
    return min(max(changed / passed, -_FASTEST), _FASTEST)
