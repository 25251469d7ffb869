"""What a field may be, and the tally of what was not."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_px4.bridge.field_checks import (
    BODY_NED,
    LOCAL_NED,
    RefusalCounter,
    all_within,
    finite,
    one_of,
    unit_quaternion,
    within,
)

BAD = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("bad", BAD)
def test_one_number_that_is_none_spoils_all(bad):
    assert finite((1.0, 2.0, 3.0)) == finite(4) == finite(()) == ""
    assert finite((1.0, bad, 3.0)) == finite(bad) == "not_finite"
    assert finite(bad, "no_thrust") == "no_thrust"


@pytest.mark.parametrize("bad", [*BAD, 1.1, -0.1])
def test_within_has_both_ends(bad):
    assert within(0.0, 0.0, 1.0) == within(1.0, 0.0, 1.0) == ""
    assert within(bad, 0.0, 1.0) == "out_of_range"


@pytest.mark.parametrize("bad", [*BAD, 5.1, -5.1])
def test_all_within_looks_at_every_number(bad):
    assert all_within((5.0, -5.0, 0.0), 5.0) == ""
    assert all_within((0.0, 0.0, bad), 5.0) == "out_of_range"


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_a_quaternion_has_length_one(q):
    length = math.hypot(*q)
    if length < 0.1:
        return
    unit = [part / length for part in q]
    assert unit_quaternion(unit) == ""
    assert unit_quaternion([0.97 * part for part in unit]) == "not_a_rotation"
    assert unit_quaternion([1.03 * part for part in unit]) == "not_a_rotation"


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (1, 0, 0), (1, 0, 0, 0, 0), (math.nan, 0, 0, 1)])
def test_what_is_no_quaternion(q):
    assert unit_quaternion(q) == "not_a_rotation"


def test_checks_are_strung_together_with_or():
    assert (
        finite(1.0) or one_of(1, (LOCAL_NED, BODY_NED)) or within(2.0, 0.0, 1.0, "far")
    ) == "far"
    assert one_of(12, (LOCAL_NED, BODY_NED)) == "wrong_frame"


def test_a_tally_keeps_how_often_and_the_first_text():
    counter = RefusalCounter()
    counter.refuse("")
    assert counter.total == 0 and counter.take_new() == []
    counter.refuse("not_finite", "position of ODOMETRY")
    counter.refuse("not_finite", "something else")
    counter.refuse("wrong_frame", "frame 3")
    assert counter.counts == {"not_finite": 2, "wrong_frame": 1}
    assert counter.total == 3
    news = [("not_finite", "position of ODOMETRY"), ("wrong_frame", "frame 3")]
    assert counter.take_new() == news
    counter.refuse("not_finite")
    assert counter.take_new() == []
    assert counter.texts == dict(news)


def test_a_tally_does_not_grow_without_end():
    counter = RefusalCounter()
    for k in range(1000):
        counter.refuse(f"word_{k}")
    assert len(counter.counts) == 65
    assert counter.counts["other"] == 936
    assert counter.total == 1000
