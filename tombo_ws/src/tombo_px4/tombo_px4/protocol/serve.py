"""The endpoint in real time: sleeps until a message comes or is due."""

from __future__ import annotations

import select
from collections.abc import Callable

from tombo_dynamics.time_base import SECOND_NS, TICK_NS
from tombo_px4.protocol.endpoint import Endpoint

Clock = Callable[[], int]
_SLIP_NS = 200_000_000
_LONGEST_NS = 4_000_000
"""Longest time between two calls, so that commands meet a recent state."""
_LOAD_NS = SECOND_NS


class BootClock:
    """Time since the vehicle's start; it is delayed when the machine is too slow."""

    def __init__(self, now_ns: int) -> None:
        self._began_ns = now_ns
        self.slipped_ns = 0
        """Total delay compared with a machine that is fast enough [ns]."""

    def boot_ns(self, now_ns: int) -> int:
        """Return the time since boot of a time of the monotonic clock."""
        return now_ns - self._began_ns

    def slip(self, behind_ns: int) -> bool:
        """Delay the clock if the vehicle is too far behind; return whether it was delayed."""
        if behind_ns <= _SLIP_NS:
            return False
        self._began_ns += behind_ns
        self.slipped_ns += behind_ns
        return True


def serve(
    endpoint: Endpoint,
    monotonic_ns: Clock,
    wall_ns: Clock,
    stop: Callable[[], bool],
    redraw: Callable[[int, BootClock], None] | None = None,
) -> BootClock:
    """Serve in real time until `stop` says so.

    Args:
        endpoint: at the vehicle's tick 0.
        monotonic_ns: paces the vehicle: a clock that never jumps.
        wall_ns: CLOCK_REALTIME, which stamps arrivals.
        stop: asked a few hundred times a second.
        redraw: called after each round with the time since boot [ns], to show how it goes.

    Returns:
        the clock, with how much it has slipped.
    """
    clock = BootClock(monotonic_ns() - endpoint.vehicle.tick * TICK_NS)
    poll = select.poll()
    watched: dict[int, int] = {}
    busy_ns, since_ns = 0, monotonic_ns()
    while not stop():
        began_ns = monotonic_ns()
        endpoint.advance(clock.boot_ns(began_ns), wall_ns())
        if clock.slip(endpoint.behind_ns):
            endpoint.say(4, "the machine is too slow: simulated time stands still meanwhile")
        if redraw is not None:
            redraw(clock.boot_ns(began_ns), clock)
        watched = _watch(poll, endpoint, watched)
        now_ns = monotonic_ns()
        busy_ns += now_ns - began_ns
        if now_ns - since_ns >= _LOAD_NS:
            endpoint.telemetry.load = busy_ns / (now_ns - since_ns)
            busy_ns, since_ns = 0, now_ns
        boot_ns = clock.boot_ns(now_ns)
        until_ns = min(endpoint.next_ns(), boot_ns + _LONGEST_NS)
        if endpoint.behind_ns < _LONGEST_NS and until_ns > boot_ns:
            poll.poll(-(-(until_ns - boot_ns) // 1_000_000))
    return clock


def _watch(poll: select.poll, endpoint: Endpoint, watched: dict[int, int]) -> dict[int, int]:
    """Watch the files that the links have now: those of TCP come and go."""
    now = {port.link.fileno(): 1 for port in endpoint.channels}
    if now.keys() != watched.keys():
        for number in watched.keys() - now.keys():
            poll.unregister(number)
        for number in now.keys() - watched.keys():
            poll.register(number, select.POLLIN)
    return now
