import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_bag.sequence_counter import SequenceCounter


def counted(*numbers, publishers=1):
    sequence_counter = SequenceCounter()
    for number in numbers:
        sequence_counter.count(number)
    sequence_counter.publishers(publishers)
    return sequence_counter


@given(st.lists(st.integers(1, 200), min_size=1, unique=True))
def test_a_single_publishers_gaps_are_losses(numbers):
    arrived = sorted(numbers)
    sequence_counter = counted(*arrived)
    assert sequence_counter.messages == len(arrived)
    assert sequence_counter.messages + sequence_counter.lost == arrived[-1] - arrived[0] + 1


@pytest.mark.parametrize(
    ("numbers", "lost"),
    [((700, 701), 0), ((498, 499, 1, 2, 5), 2)],
    ids=["sent before the recording", "a publisher that starts again"],
)
def test_what_is_no_gap_is_no_loss(numbers, lost):
    assert counted(*numbers).lost == lost


def test_numbers_of_two_publishers_are_no_losses():
    sequence_counter = counted(1, 500, 2, 501, 3, publishers=2)
    assert (sequence_counter.messages, sequence_counter.lost) == (5, 0)
    for number in (502, 4, 503, 5, 504, 6):
        sequence_counter.count(number)
    sequence_counter.publishers(1)  # one has gone; whose numbers these were is not known
    assert sequence_counter.lost == 0
    for number in (505, 508):
        sequence_counter.count(number)
    sequence_counter.publishers(0)
    assert sequence_counter.lost == 2
    assert sequence_counter.multiple_publishers
