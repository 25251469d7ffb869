"""The bytes of the suite's messages are rclpy's, both ways; others are refused."""

from __future__ import annotations

from dataclasses import fields
from functools import reduce
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy")

from rclpy.serialization import deserialize_message, serialize_message

from tombo_bag.message_codec import FORMS, MessageCodec, _parts
from tombo_dynamics.messages import neutral
from tombo_ros.conversion import array, to_ns, to_time
from tombo_ros.topic import message_class

_number = st.floats(allow_nan=False)
_stamp_ns = st.integers(0, 2**31 * 10**9 - 1)


def _drawn(kind: type, data: st.DataObject) -> Any:
    """A message with drawn numbers and times."""
    values = {}
    for declared in fields(kind):
        value = getattr(neutral(kind, data.draw(_stamp_ns)), declared.name)
        if isinstance(value, np.ndarray):
            drawn = data.draw(st.lists(_number, min_size=value.size, max_size=value.size))
            value = np.array(drawn)
        elif isinstance(value, float):
            value = data.draw(_number)
        elif type(value) is int and not declared.name.endswith("_ns"):
            value = data.draw(st.integers(0, 127))
        values[declared.name] = value
    return kind(**values)


def _plain(value: Any) -> Any:
    """A field as rclpy has it, as the dataclass has it."""
    if hasattr(value, "nanosec"):
        return to_ns(value)
    if hasattr(value, "x"):
        return array(value).tolist()
    return value.tolist() if hasattr(value, "tolist") else value


@pytest.mark.slow
@pytest.mark.parametrize("typename", sorted(FORMS))
@given(data=st.data())
def test_rclpy_reads_what_was_written_and_the_other_way_round(typename, data):
    codec, kind = MessageCodec(typename), FORMS[typename]
    sent = _drawn(kind, data)
    message = deserialize_message(codec.encode(sent), message_class(typename))
    for declared, part in zip(fields(kind), _parts(typename), strict=True):
        theirs = reduce(getattr, part.path.removesuffix(".x").split("."), message)
        assert _plain(theirs) == _plain(getattr(sent, declared.name)), declared.name
    back = codec.decode(serialize_message(message))
    for declared in fields(kind):
        assert _plain(getattr(back, declared.name)) == _plain(getattr(sent, declared.name)), (
            declared.name
        )


@given(_stamp_ns)
def test_times_survive_the_way_there_and_back(stamp: int) -> None:
    assert to_ns(to_time(stamp)) == stamp


@pytest.mark.parametrize(
    ("time_ns", "held_ns"), [(-1, 0), (1, 1), (2**31 * 10**9, (2**31 - 1) * 10**9)]
)
def test_a_stamp_stays_within_what_its_fields_hold(time_ns, held_ns):
    assert to_ns(to_time(time_ns)) == held_ns
