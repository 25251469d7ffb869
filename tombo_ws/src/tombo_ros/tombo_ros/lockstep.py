"""Lockstep: nodes on a simulated clock run exactly the schedule of the headless flight.

In each tick of 1 ms the simulator publishes its measurements. It sends each node that is due the
number of messages on each of its inputs, counted since the start. The node waits for them, takes
exactly these, steps, publishes, and answers with its own numbers. The simulator continues when
all have answered. Topics are reliable and latched, so no message is lost; a wait without result
ends in an error that names the messages.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from tombo_bag.columnar_cdr import lay_in_times, layout
from tombo_bag.topics import TopicSpec
from tombo_dynamics.core import step_due
from tombo_dynamics.time_base import SECOND_NS
from tombo_msgs.msg import LockstepNode
from tombo_ros.node_loop import LockstepError, LoopNode
from tombo_ros.qos import LOCKSTEP
from tombo_ros.topic import PolledSubscription, ReceivedMessage, TopicPublisher

_READY = TopicSpec(
    "/lockstep/ready", "tombo_msgs/msg/LockstepNode", LOCKSTEP, 0.0, "nodes of a lockstep"
)
_COUNTS = "tombo_msgs/msg/LockstepCounts"
_IDLE_PERIOD_NS = 100_000_000
"""Period at which a waiting node checks its parameters and whether to end."""


def _channel(node: str, direction: str) -> TopicSpec:
    return TopicSpec(f"/lockstep/{node}/{direction}", _COUNTS, LOCKSTEP, 0.0, "counts of messages")


class Waiter:
    """Sleeps until one of some subscriptions has a message."""

    def __init__(self, node: LoopNode, subscriptions: Sequence[PolledSubscription]) -> None:
        context = node.ros.context.handle
        assert context is not None
        self._subscriptions = subscriptions
        self._set = _rclpy.WaitSet(len(subscriptions), 0, 0, 0, 0, 0, context)

    def wait(self, timeout_ns: int) -> None:
        """Return when there is a message, or after the time-out."""
        with contextlib.ExitStack() as entered:
            self._set.clear_entities()
            for subscription in self._subscriptions:
                entered.enter_context(subscription.handle)
                self._set.add_subscription(subscription.handle)
            self._set.wait(timeout_ns)


class _Counts:
    """Messages of the type LockstepCounts with a fixed number of counts."""

    def __init__(self, number: int) -> None:
        self._message = layout(_COUNTS, {"counts": [0] * number}).records(1)
        self._has_counts = number > 0

    def encode(self, stamp_ns: int, counts: Sequence[int]) -> bytes:
        lay_in_times(self._message, "stamp", stamp_ns)
        if self._has_counts:
            self._message["counts"] = counts
        return self._message.tobytes()

    def decode(self, data: bytes) -> tuple[int, tuple[int, ...]]:
        seconds, nanoseconds, *counts = np.frombuffer(data, self._message.dtype, 1)[0].item()
        stamp_ns = int(seconds) * SECOND_NS + int(nanoseconds)
        return stamp_ns, tuple(counts[0].tolist()) if counts else ()


class LockstepMember:
    """A node's side: waits for ticks, collects their messages, answers."""

    def __init__(
        self,
        node: LoopNode,
        name: str,
        inputs: Mapping[str, PolledSubscription],
        outputs: Mapping[str, TopicPublisher],
        period_ns: int,
        steps_on_messages: bool,
    ) -> None:
        """Advertise the answers; `ticks` says that the node is ready.

        Args:
            node: the node.
            name: by which the simulator knows it.
            inputs: topic → subscription, in the order in which they are handed over.
            outputs: topic → publisher.
            period_ns: the node is due at whole multiples.
            steps_on_messages: it is due whenever a message is there for it.
        """
        self._node = node
        self._name = name
        self._inputs = inputs
        self._outputs = outputs
        self._tick = PolledSubscription(node.ros, _channel(name, "tick"))
        self._done = TopicPublisher(node.ros, _channel(name, "done"))
        self._ready = TopicPublisher(node.ros, _READY)
        self._ticks, self._answers = _Counts(len(inputs)), _Counts(len(outputs))
        self._waiter = Waiter(node, [self._tick])
        self._period_ns = period_ns
        self._steps_on_messages = steps_on_messages

    def ticks(
        self,
        step: Callable[[int, list[list[ReceivedMessage]]], None],
        idle: Callable[[], None],
        alone: bool,
    ) -> Iterator[bool]:
        """Run the ticks that have come, again and again; yield whether none waits to be run.

        Args:
            step: takes the time of the tick [ns] and the messages of each input, and publishes.
            idle: called after each tick.
            alone: sleep until one comes, which then is not waited for.

        Raises:
            LockstepError: messages of a tick don't come.
        """
        declared = LockstepNode(
            name=self._name,
            inputs=list(self._inputs),
            outputs=list(self._outputs),
            period_ns=self._period_ns,
            steps_on_messages=self._steps_on_messages,
        )
        self._ready.publish(declared)
        while not self._node.stopping:
            for received in self._tick.take_raw():
                now_ns, counts = self._ticks.decode(received.message)
                step(now_ns, self._collect(now_ns, counts))
                sent = [publisher.sent for publisher in self._outputs.values()]
                self._done.publish(self._answers.encode(now_ns, sent))
                idle()
            if alone and not self._tick.waiting():
                self._waiter.wait(_IDLE_PERIOD_NS)
                idle()
            yield not (alone or self._tick.waiting())

    def _collect(self, now_ns: int, counts: Sequence[int]) -> list[list[ReceivedMessage]]:
        """Return the messages of each input up to these counts, as soon as they are there."""
        return [
            take_until(self._node, self._name, topic, source, count, now_ns)
            for (topic, source), count in zip(self._inputs.items(), counts, strict=True)
        ]


def take_until(
    node: LoopNode, name: str, topic: str, source: PolledSubscription, count: int, now_ns: int
) -> list[ReceivedMessage]:
    """Return the messages that make up `count` since the start, as soon as they are there.

    Raises:
        LockstepError: they don't come.
    """
    if source.taken + source.waiting_number() < count:
        waiter = Waiter(node, [source])
        end = time.monotonic() + node.lockstep_patience_s
        while source.taken + source.waiting_number() < count:
            if node.stopping:
                return []
            if time.monotonic() > end:
                raise LockstepError(
                    f"lockstep: {name} waits at {now_ns * 1e-9:.3f} s for message {count} of "
                    f"{topic} and has {source.received} after {node.lockstep_patience_s:g} s"
                )
            waiter.wait(_IDLE_PERIOD_NS)
    return source.take_first(count - source.taken)


@dataclass
class _Member:
    """State of a node, kept by the simulator."""

    declared: LockstepNode
    """Its name, topics and period."""
    tick: TopicPublisher
    done: PolledSubscription
    ticks: _Counts
    answers: _Counts
    announced: tuple[int, ...]


class LockstepMaster:
    """The simulator's side: tells which nodes are due, and waits for the answers."""

    def __init__(self, node: LoopNode, names: Sequence[str]) -> None:
        """Advertise the ticks of some nodes."""
        self._node = node
        self._missing = dict.fromkeys(names)
        self._ready = PolledSubscription(node.ros, _READY)
        self._members: list[_Member] = []
        self._waiters: dict[tuple[str, ...], Waiter] = {}
        self.published: dict[str, int] = {}
        """Messages of the nodes up to the last tick, by topic."""

    @property
    def missing(self) -> list[str]:
        """Names of the nodes that are not ready."""
        for received in self._ready.take():
            declared = received.message
            if declared.name in self._missing:
                del self._missing[declared.name]
                self._members.append(self._member(declared))
        return list(self._missing)

    def _member(self, declared: Any) -> _Member:
        ros, inputs = self._node.ros, len(declared.inputs)
        return _Member(
            declared,
            TopicPublisher(ros, _channel(declared.name, "tick")),
            PolledSubscription(ros, _channel(declared.name, "done")),
            _Counts(inputs),
            _Counts(len(declared.outputs)),
            (0,) * inputs,
        )

    def run_tick(
        self,
        now_ns: int,
        sensed: Mapping[str, int],
        idle: Callable[[], None],
        *,
        last: bool = False,
    ) -> None:
        """Let all nodes that are due run a tick, and wait for their answers.

        Args:
            now_ns: time of the tick.
            sensed: topic → messages that the simulator has published, those of this tick included.
            idle: called ten times a second while it waits.
            last: the flight is over: nodes without outputs take the remaining messages.

        Raises:
            LockstepError: a node does not answer.
        """
        counts = {**self.published, **sensed}
        due: dict[str, _Member] = {}
        for member in self._members:
            node = member.declared
            expected = tuple(counts.get(topic, 0) for topic in node.inputs)
            due_now = step_due(
                node.period_ns, node.steps_on_messages, expected != member.announced, now_ns
            )
            if not node.outputs if last else due_now:
                member.announced = expected
                member.tick.publish(member.ticks.encode(now_ns, expected))
                due[node.name] = member
        end = time.monotonic() + self._node.lockstep_patience_s
        while due and not self._node.stopping:
            for name, member in list(due.items()):
                for received in member.done.take_raw():
                    stamp_ns, sent = member.answers.decode(received.message)
                    if stamp_ns == now_ns:
                        del due[name]
                        self.published.update(zip(member.declared.outputs, sent, strict=True))
            if not due:
                break
            if time.monotonic() > end:
                raise LockstepError(
                    f"lockstep: no answer to the tick at {now_ns * 1e-9:.3f} s from "
                    f"{', '.join(due)} within {self._node.lockstep_patience_s:g} s: has it ended?"
                )
            key = tuple(due)
            if key not in self._waiters:
                self._waiters[key] = Waiter(self._node, [member.done for member in due.values()])
            self._waiters[key].wait(_IDLE_PERIOD_NS)
            idle()
