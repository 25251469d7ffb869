"""The two ends of a topic: arrived messages, in order; whether two speak at once."""

from __future__ import annotations

import time
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rosgraph_msgs.msg import Clock
from tiny_node import POKE

from tombo_dynamics.time_base import SECOND_NS
from tombo_ros.conversion import to_ns, to_time
from tombo_ros.topic import PolledSubscription, TopicPublisher


class _Speaker:
    """A publisher of its own, numbered from 1."""

    def __init__(self, world: Any) -> None:
        self.node = world.node
        self.output = TopicPublisher(world.node, POKE)

    def say(self, number: int) -> None:
        self.output.publish(Clock(clock=to_time(number)))

    def close(self) -> None:
        self.node.destroy_publisher(self.output._publisher)


def _meet(*speakers: _Speaker) -> None:
    end = time.monotonic() + 60.0
    while any(s.output._publisher.get_subscription_count() == 0 for s in speakers):
        assert time.monotonic() < end
        time.sleep(0.01)


def _listening(world: Any, *speakers: _Speaker) -> PolledSubscription:
    heard = PolledSubscription(world.node, POKE)
    _meet(*speakers)
    return heard


def _wait(heard: PolledSubscription, number: int) -> None:
    end = time.monotonic() + 60.0
    while heard.received < number:
        heard.waiting()
        assert time.monotonic() < end, heard.received
        time.sleep(0.001)


def test_messages_wait_and_are_taken_once_oldest_first(world: Any) -> None:
    speaker = _Speaker(world)
    heard = _listening(world, speaker)
    assert not heard.waiting()
    assert heard.take() == []
    assert heard.last_ns is None
    began = time.time_ns()
    for number in range(20):
        speaker.say(number)
    _wait(heard, 20)
    assert heard.waiting()
    taken = heard.take()
    assert [to_ns(t.message.clock) for t in taken] == list(range(20))
    assert all(began <= t.received_ns <= time.time_ns() for t in taken)
    assert heard.last_ns == taken[-1].received_ns
    assert not heard.waiting()
    assert heard.take() == []


def test_bytes_that_are_no_message_are_counted_and_left_out(world: Any) -> None:
    speaker = _Speaker(world)
    heard = _listening(world, speaker)
    speaker.output.publish(b"\x00\x01\x00\x00\x05")
    speaker.say(3)
    _wait(heard, 2)
    assert [to_ns(t.message.clock) for t in heard.take()] == [3]
    assert heard.unreadable == 1


def _say(heard: PolledSubscription, speaker: _Speaker, number: int) -> None:
    """Publish one message more and wait for it."""
    before = heard.received
    speaker.say(number)
    _wait(heard, before + 1)


@pytest.mark.parametrize("head_start", [0, 30])
def test_two_that_speak_in_turn_are_a_crowd_until_one_is_gone(world: Any, head_start: int) -> None:
    first, second = _Speaker(world), _Speaker(world)
    heard = _listening(world, first, second)
    for number in range(head_start):
        first.say(number)
    _wait(heard, head_start)
    assert not heard.multiple_publishers(time.time_ns()), "one publisher is no crowd"
    for number in range(5):
        for speaker in (first, second):
            _say(heard, speaker, number)
    now = time.time_ns()
    assert heard.multiple_publishers(now)
    assert heard.multiple_publishers(now + SECOND_NS // 2)
    for number in range(20):
        _say(heard, first, number)
    assert not heard.multiple_publishers(now + 2 * SECOND_NS)


def test_one_that_was_restarted_is_no_crowd(world: Any) -> None:
    speaker = _Speaker(world)
    heard = _listening(world, speaker)
    for number in range(20):
        speaker.say(number)
    _wait(heard, 20)
    speaker.close()
    again = _Speaker(world)
    _meet(again)
    for number in range(20):
        again.say(number)
    _wait(heard, 40)
    assert not heard.multiple_publishers(time.time_ns())
