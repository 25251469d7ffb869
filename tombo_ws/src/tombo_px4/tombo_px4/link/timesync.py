"""Offset between two clocks from TIMESYNC round trips, in both directions.

A request carries its sender's time `ts1`; the answer brings it back with the other's time `tc1`.
The answer was written between the request's departure and the answer's arrival. Without any model
of the way, (ts1 + arrival) / 2 - tc1 is therefore wrong by at most half a round trip.

The offset follows these samples. A round trip that exceeds the quickest one has less weight: all
of the excess may be spent in one direction. The offset never leaves the bound, so it also follows
a clock that runs some percent faster.
"""

from __future__ import annotations

import math
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
_JUMP_NS = 5_000_000
_PROOFS = 3
"""Answers in a row that prove a jump of a clock."""
_NOISE_NS = 50_000.0
"""An excess that halves the weight of an answer."""
_LEAST_SHARE = 0.05
"""Share of a quick answer in the offset, once many have come: 2 s at 10 Hz."""


class TimeSync:
    """Offset between the other side's clock and ours, from TIMESYNC round trips.

    Attributes:
        offset_ns: theirs + offset = ours; None before the first answer.
        rtt_ns: of the last answer; None before.
        jumps: how often one of the clocks jumped, and the offset was measured anew.
        converged: enough answers came for stamps to be converted; a jump does not take it back,
            because one answer bounds the new offset to half a round trip.
        refused: answers without a request, or from before the request.
    """

    def __init__(self) -> None:
        self.offset_ns: int | None = None
        self.rtt_ns: int | None = None
        self.jumps = 0
        self.converged = False
        self.refused = 0
        self._pending: deque[int] = deque(maxlen=_PENDING)
        self._round_trips: deque[int] = deque(maxlen=_QUICKEST_OF)
        self._samples = 0
        self._impossible = 0
        """Answers in a row whose offset is not possible."""

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
        offset = sample if self.offset_ns is None else self.offset_ns
        error = sample - offset
        beyond = abs(error) - rtt // 2
        self._impossible = self._impossible + 1 if beyond > _JUMP_NS else 0
        if 0 < self._impossible < _PROOFS:
            return
        if self._impossible:  # a clock has jumped: begin anew
            self.jumps += 1
            self._impossible = self._samples = 0
            self._round_trips.clear()
        self._round_trips.append(rtt)
        excess = rtt - min(self._round_trips)
        weight = (_NOISE_NS / (_NOISE_NS + excess)) ** 2
        step = max(1.0 / (1 + self._samples), _LEAST_SHARE) * weight * abs(error)
        self._samples += 1
        self.converged = self.converged or self._samples >= CONVERGED
        self.rtt_ns = rtt
        self.offset_ns = offset + round(math.copysign(max(step, beyond), error))

    def to_local_time(self, theirs_ns: int) -> int:
        """Convert their time to ours; unchanged before the first answer."""
        return theirs_ns + (self.offset_ns or 0)
