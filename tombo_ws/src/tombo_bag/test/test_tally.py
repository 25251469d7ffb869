from hypothesis import given
from hypothesis import strategies as st

from tombo_bag.tally import Tally


def counted(*numbers, publishers=1):
    tally = Tally()
    for number in numbers:
        tally.seen(number)
    tally.publishers(publishers)
    return tally


@given(st.lists(st.integers(1, 200), min_size=1, unique=True))
def test_a_single_publishers_gaps_are_losses(numbers):
    arrived = sorted(numbers)
    tally = counted(*arrived)
    assert tally.messages == len(arrived)
    assert tally.messages + tally.lost == arrived[-1] - arrived[0] + 1
    assert tally.countable


def test_what_was_sent_before_the_recording_is_no_loss():
    assert counted(700, 701).lost == 0


def test_a_publisher_that_starts_anew_loses_nothing():
    assert counted(498, 499, 1, 2, 5).lost == 2


def test_numbers_of_two_publishers_are_no_losses():
    tally = counted(1, 500, 2, 501, 3, publishers=2)
    assert (tally.messages, tally.lost, tally.countable) == (5, 0, False)
    for number in (502, 4, 503, 5, 504, 6):
        tally.seen(number)
    tally.publishers(1)  # one has gone; whose numbers these were is not known
    assert tally.lost == 0
    for number in (505, 508):
        tally.seen(number)
    tally.publishers(0)
    assert tally.lost == 2
    assert tally.crowded and not tally.countable


def test_gaps_count_once():
    tally = counted(1, 4)
    tally.publishers(1)
    tally.seen(5)
    tally.publishers(0)
    assert tally.lost == 2


def test_a_middleware_without_numbers_is_said_to_have_none():
    tally = counted(None, None)
    assert (tally.messages, tally.lost, tally.countable) == (2, 0, False)
    assert tally.unnumbered and not tally.crowded
