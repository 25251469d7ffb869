"""On a busy machine a promise in time that fails is skipped; whatever else fails is a failure."""

from __future__ import annotations

from pathlib import Path

import pytest

from empty_loop import EmptyLoop

pytest_plugins = "pytester"

ROOT = Path(__file__).parents[2]
TESTS = """
import pytest
from in_time import in_time

pytestmark = [pytest.mark.real_time]

def test_late():
    with in_time():
        assert 3.0 < 2.0

def test_nothing_came():
    raise TimeoutError("no answer")

def test_wrong():
    assert "landed" == "crashed"

def test_wrong_while_in_time():
    with in_time():
        assert 1.0 < 2.0
        raise KeyError("landed")
"""


@pytest.mark.parametrize(("late_ms", "skipped"), [(50.0, 2), (1.0, 0)])
def test_only_a_promise_in_time_is_skipped(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, late_ms: float, skipped: int
) -> None:
    monkeypatch.setattr(EmptyLoop, "late_ms", lambda loop: late_ms)
    pytester.makeconftest((ROOT / "conftest.py").read_text())
    pytester.makeini("[pytest]\nmarkers = real_time\n nodes")
    pytester.makepyfile(TESTS)
    found = pytester.runpytest_inprocess("-rs", "-p", "no:cacheprovider")
    found.assert_outcomes(skipped=skipped, failed=4 - skipped)
    if skipped:
        found.stdout.fnmatch_lines("*the machine was late by 50 ms (*assert 3.0 < 2.0*")
