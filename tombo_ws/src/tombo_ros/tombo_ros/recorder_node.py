"""Records topics as they come into a rosbag2 folder or one MCAP file. See docs/recording.md.

Messages are taken as bytes and go into the file through the same `McapSink` as those of the
headless flight. Log times are the times of reception by the machine's clock, also when the flight
runs in simulated time; publish times are those of the sender, stamps in headers stay as they are.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from tombo_bag.qos import Qos
from tombo_bag.rolling_sink import RollingOptions, RollingSink
from tombo_bag.schemas import type_hash
from tombo_bag.tally import Tally
from tombo_bag.topics import CLOCK, TOPICS
from tombo_dynamics.errors import InputError
from tombo_ros.health import ERROR
from tombo_ros.loop_node import LoopNode, run
from tombo_ros.qos import profile
from tombo_ros.topic import PolledGroup, message_class

SECOND_NS = 1_000_000_000
POLLS_HZ = 200.0
DEPTH = 4000
"""Messages a topic may be behind: four seconds at 1 kHz."""
FLUSH_NS = 400_000_000
"""What a kill -9 may cost is this and what is under way."""
LOOK_NS = SECOND_NS // 2
"""How often publishers are looked for."""


class Source:
    """One recorded topic: a polled subscription and what it counts."""

    def __init__(self, node: Any, sink: RollingSink, name: str, typename: str, qos: Qos) -> None:
        self._sink = sink
        self.name = name
        self.typename = typename
        self.tally = Tally()
        self._node = node
        self._kind = message_class(typename)
        self._subscribe(qos)

    def _subscribe(self, qos: Qos) -> None:
        self.qos = qos
        self._subscription = self._node.create_subscription(
            self._kind,
            self.name,
            _nobody,
            profile(qos, DEPTH),
            callback_group=PolledGroup(),
            raw=True,
        )
        self._take = self._subscription.handle.take_message

    def adapt(self, qos: Qos) -> None:
        """Ask for less where a publisher doesn't offer what is asked for."""
        weaker = weakest((self.qos, qos))
        if weaker != self.qos:
            self._node.destroy_subscription(self._subscription)
            self._subscribe(weaker)

    def announce(self) -> None:
        """Make the topic one of the recording, whether or not it ever speaks."""
        self._sink.add_topic(self.name, self.typename, self.qos)

    def take(self) -> None:
        """Record all that has come."""
        item = self._take(self._kind, True)
        if item is not None and not self.tally.messages:
            self.announce()
        while item is not None:
            message, info = item
            received = info["received_timestamp"]
            self.tally.seen(info["publication_sequence_number"])
            sent = info["source_timestamp"] or received
            self._sink.write(self.name, message, received, sent)
            item = self._take(self._kind, True)


class RecorderNode(LoopNode):
    """Polls the topics, writes what has come, looks for new publishers."""

    def __init__(self) -> None:
        super().__init__("recorder", POLLS_HZ)
        # A recording goes on when the simulated time stands still.
        self.sim_time = False
        self.exit_code = 0
        self._started_ns = time.time_ns()
        self._stopped_ns = 0
        self._undescribed: dict[str, str] = {}
        self._sources: dict[str, Source] = {}
        known = [name for name in TOPICS if name != CLOCK.name]
        names = self.declare("topics", known, "names of the topics to record")
        self._all = self.declare("all", False, "record every other topic on the graph too")
        self._specs = {
            self.ros.resolve_topic_name(name.lstrip("/") if name in TOPICS else name): TOPICS.get(
                name
            )
            for name in names
        }
        self._sink = RollingSink(self._options(), self._notes)
        for name, spec in self._specs.items():
            if spec is not None:
                self._subscribe(name, spec.typename, spec.qos, complain=False)
        self._written_at = self._counted_at = time.monotonic_ns()
        self._searched_at = 0
        self._seen_before = 0
        self.ros.get_logger().info(f"recording to {self._sink.options.target}")

    def _options(self) -> RollingOptions:
        now = time.strftime("%Y_%m_%d-%H_%M_%S", time.localtime(self._started_ns // SECOND_NS))
        output = self.declare("output", "", "folder to make; empty: recording_ with the time")
        file = self.declare("single_file", "", "in place of a folder: one file, ending in .mcap")
        size_max = self.declare("file_size_max", 0, "a larger file ends [bytes]; 0: no limit")
        duration_max = self.declare(
            "file_duration_max", 0.0, "a longer file ends [s]; 0: no limit"
        )
        compression = self.declare("compression", "zstd", "of the file: zstd, lz4 or none")
        if output and file:
            raise InputError(
                f"parameters output '{output}' and single_file '{file}'; accepted: one of them"
            )
        return RollingOptions(
            Path(file or output or f"recording_{now}").absolute(),
            single_file=bool(file),
            file_size_max=size_max,
            file_duration_max=duration_max,
            compression=compression,
        )

    def step(self, now_ns: int) -> None:
        """Take what has come; now and then write it, look around, report."""
        for source in self._sources.values():
            source.take()
        clock = time.monotonic_ns()
        if clock - self._written_at >= FLUSH_NS:
            self._written_at = clock
            self._guarded(lambda: self._sink.flush(now_ns))
        elif clock - self._searched_at >= LOOK_NS:
            self._searched_at = clock
            self._look()
        elif clock - self._counted_at >= SECOND_NS:
            self._figures((clock - self._counted_at) / SECOND_NS)
            self._counted_at = clock

    def close(self) -> None:
        """Take what is left, finish the file, say in one line what was recorded."""
        for source in self._sources.values():
            source.take()
        self._look()
        self._stopped_ns = time.time_ns()
        self._guarded(self._sink.close)
        if self._sink.unwritten:
            self.exit_code = 1
        self._figures(1.0)
        self._say_what_was_recorded()

    def _guarded(self, action: Callable[[], None]) -> None:
        """Write; if the disk won't, say so and let the recording end."""
        try:
            action()
        except OSError as error:
            reason = error.strerror or str(error)
            text = f"can't write {self._sink.path}: {reason}; the recording ends"
            self.health.fault("disk", True, text, ERROR)
            self.report(time.time_ns())
            self.exit_code = 1
            self.stop()

    def _look(self) -> None:
        """Find new publishers; adapt to what they offer; count them."""
        wanted = dict.fromkeys(self._specs)
        if self._all:
            wanted.update(dict.fromkeys(name for name, _ in self.ros.get_topic_names_and_types()))
        for name in wanted:
            offers = self.ros.get_publishers_info_by_topic(name)
            source = self._sources.get(name)
            if offers:
                typename = offers[0].topic_type
                spec = self._specs.get(name)
                depth = spec.qos.depth if spec is not None else Qos().depth
                qos = weakest(_offered(offer, depth) for offer in offers)
                if source is None:
                    source = self._subscribe(name, typename, qos)
                if source is None:
                    continue
                source.adapt(qos)
                source.announce()
                for offer in offers:
                    self._compare(source, offer)
            if source is not None:
                source.tally.publishers(len(offers))

    def _subscribe(
        self, name: str, typename: str, qos: Qos, *, complain: bool = True
    ) -> Source | None:
        """Begin to record a topic, if its type is installed and can be described."""
        if name in self._undescribed:
            return None
        try:
            type_hash(typename)
            source = self._sources[name] = Source(self.ros, self._sink, name, typename, qos)
        except (InputError, ImportError, AttributeError, ValueError) as error:
            if complain:
                self._undescribed[name] = typename
                reason = str(error).partition("; accepted")[0]
                self.health.fault(
                    f"undescribed.{name}", True, f"{name} is not recorded: {typename}: {reason}"
                )
            return None
        return source

    def _compare(self, source: Source, offer: Any) -> None:
        """Complain of a publisher whose type is not the one that stands in the file."""
        if offer.topic_type != source.typename:
            text = f"{offer.topic_type} is not recorded, {source.typename} is"
            self.health.fault(f"second_type.{source.name}", True, f"{source.name}: {text}")
            return
        theirs, ours = str(offer.topic_type_hash), type_hash(source.typename)
        if theirs.startswith("RIHS01_") and theirs != ours:
            text = f"{source.name}: {source.typename} of node {offer.node_name} is another version"
            self.health.fault(f"other_version.{source.name}", True, text)

    def _figures(self, span_s: float) -> None:
        messages = sum(source.tally.messages for source in self._sources.values())
        crowded = [name for name, source in self._sources.items() if source.tally.crowded]
        for key, value in (
            ("messages", messages),
            ("lost", self._lost()),
            ("unwritten", self._sink.unwritten),
            ("rate_hz", round((messages - self._seen_before) / span_s, 1)),
            ("bytes", self._sink.size),
            ("file", str(self._sink.path)),
            ("crowded", " ".join(crowded)),
        ):
            self.health.value(key, value)
        self._seen_before = messages

    def _lost(self) -> int:
        return sum(source.tally.lost for source in self._sources.values())

    def _notes(self) -> dict[str, str]:
        """Return what the file says about its own making."""
        tallies = {name: self._sources[name].tally for name in sorted(self._sink.topics)}
        return {
            "started_ns": str(self._started_ns),
            "stopped_ns": str(self._stopped_ns or ""),
            "messages": str(self._sink.messages),
            "lost": str(self._lost()),
            "unwritten": str(self._sink.unwritten),
            "crowded": " ".join(name for name, tally in tallies.items() if tally.crowded),
            "unnumbered": " ".join(name for name, tally in tallies.items() if tally.unnumbered),
            **{f"lost:{name}": str(tally.lost) for name, tally in tallies.items()},
            **{f"undescribed:{name}": kind for name, kind in self._undescribed.items()},
        }

    def _say_what_was_recorded(self) -> None:
        seconds = (self._stopped_ns - self._started_ns) / SECOND_NS
        tallies = [source.tally for source in self._sources.values() if source.tally.messages]
        uncounted = sum(not tally.countable for tally in tallies)
        lost = f"lost {self._lost()}"
        if uncounted:
            lost += f" (not countable on {uncounted} topics with several publishers)"
        if self._sink.unwritten:
            lost += f", {self._sink.unwritten} could not be written"
        sys.stdout.write(
            f"recorded {self._sink.messages} messages on {len(tallies)} topics in {seconds:.1f} s,"
            f" {lost}, {self._sink.size / 1e6:.1f} MB: {self._sink.options.target}\n"
        )
        sys.stdout.flush()


def weakest(offers: Iterable[Qos]) -> Qos:
    """Return what all of some publishers offer."""
    every = list(offers)
    reliable = all(qos.reliability == "reliable" for qos in every)
    latched = all(qos.durability == "transient_local" for qos in every)
    return Qos(
        every[0].depth,
        "reliable" if reliable else "best_effort",
        "transient_local" if latched else "volatile",
    )


def _offered(offer: Any, depth: int) -> Qos:
    """Return a publisher's offer; discovery tells everything but the depth."""
    there = offer.qos_profile
    return Qos(
        there.depth or depth,
        "reliable" if there.reliability == ReliabilityPolicy.RELIABLE else "best_effort",
        "transient_local" if there.durability == DurabilityPolicy.TRANSIENT_LOCAL else "volatile",
    )


def _nobody(message: Any) -> None:
    """Take the place of the callback that rclpy asks for."""


def main(argv: Sequence[str] | None = None) -> None:
    """Be the recorder."""
    made: list[RecorderNode] = []

    def make() -> RecorderNode:
        made.append(RecorderNode())
        return made[0]

    code = run(make, argv)
    sys.exit(code or made[0].exit_code)
