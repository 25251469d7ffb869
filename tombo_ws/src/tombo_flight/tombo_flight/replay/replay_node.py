"""Plays recorded inputs to the suite's nodes over DDS and records their answers.

    python -m tombo_flight.replay.replay_node JOB

JOB is a JSON file:

- inputs: MCAP file, published as recorded, with `/clock`; its log times are the nodes' time
- outputs: MCAP file that gets what the nodes say, with log times of the same clock
- speed: of recorded time against real time
- listeners: topic → number of nodes that listen; playing begins when they are there
- topics: topic of `outputs` → the name under which a node says it here
- answers: as `["/mocap/pose", "/detector/status", 1, 3, true]`: a node answers each message of the
  first topic by one of the second; playing waits while more than 3 have no answer, so that a slow
  machine stretches the time and loses nothing (see `ResponseTracker`)

Says `{"missing": [...]}` while it waits, `{"played": share}`, and at last
`{"done": {"sent": n, "received": n, "late_ms": x}}`, a JSON line each.
"""

from __future__ import annotations

import json
import signal
import struct
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy

from tombo_bag.formats.mcap_sink import McapSink
from tombo_bag.formats.reader import Bag
from tombo_bag.message_template import MessageTemplate
from tombo_bag.topics import CLOCK, TOPICS, TopicSpec
from tombo_dynamics.time_base import SECOND_NS, TICK_NS
from tombo_ros.pacing import sleep_until
from tombo_ros.topic import PolledSubscription, TopicPublisher

_CLOCK_NS = TICK_NS
"""Longest step of `/clock`, in the nodes' time."""
_LEAD_NS = SECOND_NS // 2
"""Time of the clock before the first message, and after the last."""
_DEPTH = 5000
_PATIENCE_NS, _FIRST_NS = SECOND_NS // 4, 5 * SECOND_NS
"""Longest wait for an answer, and for the first one; wall time."""
_MAX_MISSED = 4
"""After this many missing answers in a row, no answer is waited for."""


class ResponseTracker:
    """Tracks which messages a node has answered."""

    def __init__(self, asked: str, said: str, share: int, most: int, at_once: bool) -> None:
        """Begin.

        Args:
            asked: topic that the node takes.
            said: topic of its answers.
            share: messages that one answer is for; 0: an answer's stamp tells how far the node is.
            most: messages, or ms, that it may be behind.
            at_once: it answers the first message, for which it may need longer.
        """
        self.asked = asked
        self.said = said
        self._share = share
        self._most = most if share else most * 1_000_000
        self._behind = 0
        self._first = at_once
        self._now_ns: int | None = None
        self._missed = 0

    def sent(self, now_ns: int) -> None:
        """Record a sent message."""
        if self._share:
            self._behind += 1
        elif self._now_ns is not None:
            self._behind = now_ns - self._now_ns

    def came(self, message: bytes) -> None:
        """Record an answer."""
        seconds, rest = struct.unpack_from("<iI", message, 4)
        self._now_ns = seconds * SECOND_NS + rest
        self._missed = 0
        self._behind = max(self._behind - self._share, 0) if self._share else 0

    @property
    def behind(self) -> bool:
        """Whether too much is unanswered."""
        if self._now_ns is None:
            return self._first
        return self._missed < _MAX_MISSED and self._behind > self._most

    @property
    def patience_ns(self) -> int:
        """Longest wait for the next answer, wall time."""
        return _FIRST_NS if self._now_ns is None else _PATIENCE_NS

    def skip_missing(self) -> None:
        """Go on without the answers that have not come: a message was lost."""
        self._missed += 1
        self._behind = 0
        self._first = False


class Player:
    """Publishes the recorded inputs and records the answers."""

    def __init__(
        self,
        node: Any,
        inputs: Path,
        outputs: Path,
        topics: Mapping[str, str],
        answers: Sequence[ResponseTracker],
    ) -> None:
        self._answers = answers
        self._messages = list(_in_order(Bag(inputs)))
        self._node = node
        names = {topic for _, topic, _ in self._messages}
        self._outputs = {
            name: TopicPublisher(node, _with_deep_queue(TOPICS[name])) for name in names
        }
        self._inputs = {
            name: PolledSubscription(node, replace(TOPICS[name], name=here), _DEPTH)
            for name, here in topics.items()
        }
        self._sink = McapSink(outputs)
        self._channels = {
            name: self._sink.add_channel(name, TOPICS[name].typename, TOPICS[name].qos)
            for name in topics
        }
        self._clock_out = TopicPublisher(node, CLOCK)
        self._clock = MessageTemplate(CLOCK.typename, {})
        self.now_ns = self._messages[0][0] - _LEAD_NS
        self.stopped = False
        self.received = 0
        self.late_ns = 0

    def missing(self, listeners: dict[str, int]) -> list[str]:
        """Return the topics without a subscriber or publisher."""
        deaf = [
            name
            for name, output in self._outputs.items()
            if self._node.count_subscribers(output.spec.name.lstrip("/")) < listeners.get(name, 1)
        ]
        mute = [
            name
            for name, source in self._inputs.items()
            if not self._node.count_publishers(source.topic)
        ]
        return [*deaf, *mute]

    def publish_clock(self) -> None:
        """Publish `/clock`."""
        seconds, rest = divmod(self.now_ns, SECOND_NS)
        self._clock.set("clock.sec", seconds)
        self._clock.set("clock.nanosec", rest)
        self._clock_out.publish(self._clock.data())

    def play(self, speed: float) -> None:
        """Publish everything, each message at its time, and listen meanwhile."""
        start_ns, end_ns = self.now_ns, self._messages[-1][0]
        deadline = float(time.monotonic_ns())
        said = 0.0
        for due_ns, topic, message in [*self._messages, (end_ns + _LEAD_NS, "", b"")]:
            while self.now_ns < due_ns and not self.stopped:
                before = self.now_ns
                self.now_ns = min(before + _CLOCK_NS, due_ns)
                deadline += (self.now_ns - before) / speed
                self.publish_clock()
                deadline = self._wait(deadline)
                self.subscribe()
            if self.stopped:
                return
            if topic:
                self._outputs[topic].publish(message)
                deadline += self._answered(topic)
            share = (self.now_ns - start_ns) / max(end_ns - start_ns, 1)
            if share - said > 0.01:
                said = share
                _say({"played": min(share, 1.0)})

    def _wait(self, deadline: float) -> float:
        """Sleep until the deadline; return it, or now if later: late runs are not caught up."""
        now = time.monotonic_ns()
        if now < deadline:
            sleep_until(int(deadline))
            return deadline
        self.late_ns += int(now - deadline)
        return float(now)

    def _answered(self, topic: str) -> int:
        """Wait for whom this message has left behind; return how long that took [ns]."""
        began = time.monotonic_ns()
        for answers in self._answers:
            if answers.asked != topic:
                continue
            answers.sent(self.now_ns)
            while answers.behind and not self.stopped:
                self.subscribe()
                if time.monotonic_ns() - began > answers.patience_ns:
                    answers.skip_missing()
                elif answers.behind:
                    sleep_until(time.monotonic_ns() + 200_000)
        waited = time.monotonic_ns() - began
        return waited if waited > 200_000 else 0

    def subscribe(self) -> None:
        """Record the messages received."""
        for name, source in self._inputs.items():
            for taken in source.take_raw():
                self._sink.write(self._channels[name], taken.message, self.now_ns)
                self.received += 1
                for answers in self._answers:
                    if answers.said == name:
                        answers.came(taken.message)

    def close(self) -> int:
        """Finish the file; return how many messages were to be sent."""
        self.subscribe()
        self._sink.close()
        return len(self._messages)


def _with_deep_queue(spec: TopicSpec) -> TopicSpec:
    """Return the topic with a queue in which nothing gives way to newer messages."""
    return replace(spec, qos=replace(spec.qos, depth=_DEPTH))


def _in_order(bag: Bag) -> Iterator[tuple[int, str, bytes]]:
    rows = []
    for topic, raw in bag.messages(bag.topics).items():
        for time_ns, message in zip(raw.log_times_ns.tolist(), raw.messages, strict=True):
            rows.append((time_ns, topic, message))
    return iter(sorted(rows, key=lambda row: row[0]))


def _say(what: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main(argv: Sequence[str] | None = None) -> None:
    """Play; leave with 0, or 1 when it was stopped."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    job = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = rclpy.create_node("replay")
    answers = [ResponseTracker(*pair) for pair in job["answers"]]
    player = Player(node, Path(job["inputs"]), Path(job["outputs"]), job["topics"], answers)

    def stop(number: int, frame: Any) -> None:
        player.stopped = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    reported: list[str] | None = None
    while not player.stopped:
        missing = player.missing(job["listeners"])
        player.publish_clock()
        player.subscribe()
        if missing != reported:
            reported = missing
            _say({"missing": missing})
        if not missing:
            player.play(job["speed"])
            break
        time.sleep(0.05)
    sent = player.close()
    if not player.stopped:
        late = round(player.late_ns / 1e6, 1)
        _say({"done": {"sent": sent, "received": player.received, "late_ms": late}})
    node.destroy_node()
    rclpy.shutdown()
    sys.exit(1 if player.stopped else 0)


if __name__ == "__main__":
    main()
