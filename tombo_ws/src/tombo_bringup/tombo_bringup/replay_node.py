"""Plays a file of recorded inputs to the suite's nodes over DDS and writes down what they answer.

    python -m tombo_bringup.replay_node INPUTS OUTPUTS SPEED LISTENERS TOPIC [TOPIC ...]

INPUTS is an MCAP file whose log times are the nodes' time; it is published with `/clock`, as
recorded. OUTPUTS gets the messages on the TOPICs, with log times of the same clock. Playing begins
when every input has its subscribers (LISTENERS, as `{"/mocap/pose": 1}`) and every TOPIC a
publisher. Says `{"missing": [...]}` while it waits, `{"played": share}` and at last
`{"done": {"sent": n, "received": n, "late_ms": x}}`, a JSON line each.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import rclpy

from tombo_bag.mcap_sink import McapSink
from tombo_bag.reader import Bag
from tombo_bag.topics import CLOCK, TOPICS
from tombo_ros.pacing import sleep_until
from tombo_ros.topic import Input, Output
from tombo_ros.wire import Wire

SECOND_NS = 1_000_000_000
_CLOCK_NS = 1_000_000
"""`/clock` moves on at least so often, in the nodes' time."""
_LEAD_NS = SECOND_NS // 2
"""The clock begins so long before the first message, and goes on so long after the last."""
_DEPTH = 5000


class Player:
    """The rest of the world, as it was recorded."""

    def __init__(self, node: Any, inputs: Path, outputs: Path, topics: Sequence[str]) -> None:
        self._messages = list(_in_order(Bag(inputs)))
        self._node = node
        self._outputs = {
            name: Output(node, TOPICS[name]) for name in {topic for _, topic, _ in self._messages}
        }
        self._inputs = {name: Input(node, TOPICS[name], _DEPTH) for name in topics}
        self._sink = McapSink(outputs)
        self._channels = {
            name: self._sink.add_channel(name, TOPICS[name].typename, TOPICS[name].qos)
            for name in topics
        }
        self._clock_out = Output(node, CLOCK)
        self._clock = Wire(CLOCK.typename, {})
        self.now_ns = self._messages[0][0] - _LEAD_NS
        self.stopped = False
        self.received = 0
        self.late_ns = 0

    def missing(self, listeners: dict[str, int]) -> list[str]:
        """Return the topics that wait for somebody."""
        deaf = [
            name
            for name, output in self._outputs.items()
            if self._node.count_subscribers(output.spec.name.lstrip("/")) < listeners.get(name, 1)
        ]
        mute = [name for name in self._inputs if not self._node.count_publishers(name.lstrip("/"))]
        return [*deaf, *mute]

    def tell_time(self) -> None:
        """Publish `/clock`."""
        seconds, rest = divmod(self.now_ns, SECOND_NS)
        self._clock.set("clock.sec", seconds)
        self._clock.set("clock.nanosec", rest)
        self._clock_out.publish(self._clock.data())

    def play(self, speed: float) -> None:
        """Publish everything, each message at its time, and listen meanwhile."""
        began_ns, start_ns = time.monotonic_ns(), self.now_ns
        end_ns = self._messages[-1][0]
        said = 0.0
        for due_ns, topic, message in [*self._messages, (end_ns + _LEAD_NS, "", b"")]:
            while self.now_ns < due_ns and not self.stopped:
                self.now_ns = min(self.now_ns + _CLOCK_NS, due_ns)
                deadline = began_ns + int((self.now_ns - start_ns) / speed)
                if deadline > time.monotonic_ns():
                    sleep_until(deadline)
                else:
                    self.late_ns = max(self.late_ns, time.monotonic_ns() - deadline)
                self.tell_time()
                self.listen()
            if self.stopped:
                return
            if topic:
                self._outputs[topic].publish(message)
            share = (self.now_ns - start_ns) / max(end_ns - start_ns, 1)
            if share - said > 0.01:
                said = share
                _say({"played": min(share, 1.0)})

    def listen(self) -> None:
        """Write down what has come."""
        for name, source in self._inputs.items():
            for taken in source.take_raw():
                self._sink.write(self._channels[name], taken.message, self.now_ns)
                self.received += 1

    def close(self) -> int:
        """Finish the file; return how many messages were to be sent."""
        self.listen()
        self._sink.close()
        return len(self._messages)


def _in_order(bag: Bag) -> Iterator[tuple[int, str, bytes]]:
    rows = []
    for topic in bag.topics:
        numbers = [number for number, c in bag.channels.items() if c.topic == topic]
        raw = bag.messages(*numbers)
        for time_ns, message in zip(raw.log_times_ns.tolist(), raw.messages, strict=True):
            rows.append((time_ns, topic, message))
    return iter(sorted(rows, key=lambda row: row[0]))


def _say(what: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def main(argv: Sequence[str] | None = None) -> None:
    """Play; leave with 0, or 1 when it was stopped."""
    arguments = sys.argv[1:] if argv is None else list(argv)
    inputs, outputs, speed, listeners, topics = (
        Path(arguments[0]),
        Path(arguments[1]),
        float(arguments[2]),
        json.loads(arguments[3]),
        arguments[4:],
    )
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = rclpy.create_node("replay")
    player = Player(node, inputs, outputs, topics)

    def stop(number: int, frame: Any) -> None:
        player.stopped = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    told: list[str] | None = None
    while not player.stopped:
        missing = player.missing(listeners)
        player.tell_time()
        player.listen()
        if missing != told:
            told = missing
            _say({"missing": missing})
        if not missing:
            player.play(speed)
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
