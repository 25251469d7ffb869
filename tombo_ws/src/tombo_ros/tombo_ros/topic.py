"""The two ends of a topic: an input that is polled, and an output."""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from tombo_bag.message_codec import FORMS, MessageCodec
from tombo_bag.qos import Qos
from tombo_bag.topics import TopicSpec
from tombo_dynamics.core import START_GRACE_NS
from tombo_dynamics.time_base import SECOND_NS
from tombo_ros.qos import profile


def message_class(typename: str) -> Any:
    """Return the class of `geometry_msgs/msg/PoseStamped`.

    Raises:
        ImportError: the package is not installed.
    """
    package, kind, name = typename.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)


class _PolledGroup(CallbackGroup):
    """Keeps subscriptions out of every executor: the loop takes their messages itself."""

    def can_execute(self, entity: Any) -> bool:
        """Return False: never by an executor."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Return False, as `can_execute`."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


class ReceivedMessage(NamedTuple):
    """One message as it arrived."""

    message: Any
    """Of the topic's class, or its bytes (CDR)."""
    received_ns: int
    """When the middleware had it, system clock."""


class PolledSubscription:
    """A subscription without callback: `take` returns the messages since the last call.

    A message costs 2 us as bytes, against some 100 us for a callback of an executor.
    """

    def __init__(self, node: Node, spec: TopicSpec, depth: int | None = None) -> None:
        self.spec = spec
        self.kind = message_class(spec.typename)
        self.topic = spec.name.removeprefix("/")
        self._node = node
        self._subscribe(spec.qos, depth)
        self.last_ns: int | None = None
        """When the newest message was received; None before the first."""
        self.received = 0
        self.unreadable = 0
        """Messages whose bytes are none of this type."""
        self._made_ns = time.time_ns()
        self._waiting: list[ReceivedMessage] = []
        self._sequence = 0
        self._turned_ns = [0, 0]

    def _subscribe(self, qos: Qos, depth: int | None) -> None:
        """Subscribe to the bytes of the topic; no executor takes them."""
        self._subscription = self._node.create_subscription(
            self.kind,
            self.topic,
            lambda message: None,
            profile(qos, depth),
            callback_group=_PolledGroup(),
            raw=True,
        )
        self._take = self._subscription.handle.take_message

    def waiting(self) -> bool:
        """Return whether there is a message to take."""
        return self.waiting_number() > 0

    def waiting_number(self) -> int:
        """Return how many messages there are to take."""
        self.pull()
        return len(self._waiting)

    @property
    def handle(self) -> Any:
        """The subscription as the middleware's wait sets know it."""
        return self._subscription.handle

    @property
    def taken(self) -> int:
        """How many messages have been taken."""
        return self.received - len(self._waiting)

    def take_first(self, number: int) -> list[ReceivedMessage]:
        """Return the bytes of the oldest messages that have arrived, so many."""
        messages, self._waiting = self._waiting[:number], self._waiting[number:]
        return messages

    def take_raw(self) -> list[ReceivedMessage]:
        """Return the bytes of all messages that have arrived, oldest first."""
        self.pull()
        messages, self._waiting = self._waiting, []
        return messages

    def pull(self) -> None:
        """Take what has arrived from the middleware."""
        item = self._take(self.kind, True)
        while item is not None:
            data, info = item
            received = info["received_timestamp"] or time.time_ns()  # 0: not every DDS tells
            sequence = info["publication_sequence_number"]
            self._waiting.append(ReceivedMessage(data, received))
            self.last_ns = received
            self.received += 1
            if sequence <= self._sequence:
                self._turned_ns = [self._turned_ns[1], received]
            self._sequence = sequence
            item = self._take(self.kind, True)

    def multiple_publishers(self, now_ns: int) -> bool:
        """Return whether two publishers have published here within the last second.

        A publisher numbers its messages. One that was restarted makes the numbers fall once;
        with two publishers the numbers decrease repeatedly. (The middleware's own count is of no
        use here: it keeps a killed publisher for 20 s.)
        """
        first, second = self._turned_ns
        return first > 0 and second - first < SECOND_NS and now_ns - second < SECOND_NS

    def take(self) -> list[ReceivedMessage]:
        """Return all messages that have arrived, oldest first."""
        messages = []
        for taken in self.take_raw():
            try:
                message = deserialize_message(taken.message, self.kind)
            except Exception:  # rclpy's own class; the message is counted, not lost in silence
                self.unreadable += 1
                continue
            messages.append(ReceivedMessage(message, taken.received_ns))
        return messages

    def silent(self, now_ns: int, limit_s: float) -> bool:
        """Return whether nothing has come for `limit_s`; before the first message, for 10 s.

        Nodes start in any order: a neighbour may still be missing.
        """
        if self.last_ns is None:
            return now_ns - self._made_ns > START_GRACE_NS
        return now_ns - self.last_ns > limit_s * SECOND_NS


class TopicPublisher:
    """A publisher."""

    def __init__(self, node: Node, spec: TopicSpec) -> None:
        self.spec = spec
        self.kind = message_class(spec.typename)
        self._publisher = node.create_publisher(
            self.kind, spec.name.lstrip("/"), profile(spec.qos)
        )
        self._codec = MessageCodec(spec.typename) if spec.typename in FORMS else None
        self.sent = 0
        """Messages published."""

    def publish(self, message: Any) -> None:
        """Send a message, or its bytes (CDR)."""
        self._publisher.publish(message)
        self.sent += 1

    def send(self, message: Any) -> None:
        """Send a message given as a dataclass of `tombo_dynamics.messages`."""
        assert self._codec is not None
        self.publish(self._codec.encode(message))

    def wait_for_all_acked(self, patience_s: float) -> bool:
        """Return whether reliable subscribers have all messages; wait `patience_s` at most."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=max(patience_s, 0.0))))
