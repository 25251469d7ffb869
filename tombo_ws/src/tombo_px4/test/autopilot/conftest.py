"""Benches of the endpoint, for tests that need no other than the default one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from endpoint_bench import Bench, bench


@pytest.fixture
def fresh() -> Iterator[Bench]:
    """A bench at the vehicle's start."""
    with bench() as made:
        yield made


@pytest.fixture
def b(fresh: Bench) -> Bench:
    """A bench whose vehicle can be armed."""
    fresh.settle()
    return fresh
