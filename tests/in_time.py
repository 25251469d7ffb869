"""Promises in time, as tests make them: the only ones that a busy machine may break.

Assertions outside of it hold on any machine; conditions are waited for, with patience.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class NotInTime(AssertionError):
    """A deadline, a rate or a latency was not kept."""


@contextmanager
def in_time() -> Iterator[None]:
    """Assert promises in time: `with in_time(): assert took_s < 3.0`."""
    try:
        yield
    except AssertionError as missed:
        raise NotInTime(*missed.args) from missed
