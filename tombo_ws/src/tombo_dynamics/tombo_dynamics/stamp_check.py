"""The one rule on stamps from the future: how far a stamp may be ahead of the present."""

from __future__ import annotations

from tombo_dynamics.jit import compiled_call

MAX_FUTURE_NS = 5_000_000
"""A stamp may be this far ahead: two clocks of one machine agree better."""


@compiled_call
def is_future(stamp_ns: int, now_ns: int) -> bool:
    """Return whether a stamp can't be right, because that time is yet to come.

    Args:
        stamp_ns: time of capture.
        now_ns: when the message was received, by the same clock. Whose clock is less sure than
            that adds what it may be behind: `Core.clock_slack_ns`, the error of a synchronisation.
    """
    return bool(stamp_ns > now_ns + MAX_FUTURE_NS)
