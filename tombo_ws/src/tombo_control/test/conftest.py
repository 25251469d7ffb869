"""A hovering vehicle, of which each test flies a copy."""

import copy

import pytest

from lockstep_bench import Lockstep, hovering


@pytest.fixture(scope="session")
def _hovering() -> Lockstep:
    return hovering()


@pytest.fixture
def flight(_hovering: Lockstep) -> Lockstep:
    return copy.deepcopy(_hovering)
