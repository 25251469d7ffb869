"""Records topics as they come into a rosbag2 folder or one MCAP file. See docs/recording.md.

Messages are taken as bytes and go into the file through the same `McapSink` as those of the
headless flight. Log times are the times of reception by the machine's clock, also when the flight
runs in simulated time; publish times are those of the sender, stamps in headers stay as they are.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from tombo_bag.formats.bag_sink import BagSink
from tombo_bag.qos import STATE, Qos
from tombo_bag.schemas import type_hash
from tombo_bag.sequence_counter import SequenceCounter
from tombo_bag.topics import CLOCK, TOPICS, TopicSpec
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_ros.core_node import main_of
from tombo_ros.health import ERROR
from tombo_ros.lockstep import LockstepMember
from tombo_ros.node_loop import LoopNode
from tombo_ros.pacing import RECORDER
from tombo_ros.qos import UNCOUNTED, lockstep_spec
from tombo_ros.topic import PolledSubscription

POLLS_HZ = 200.0
DEPTH = 5000
"""Messages a topic may be behind: five seconds at 1 kHz. Fast DDS keeps no more, whatever is asked
for."""
FLUSH_NS = 400_000_000
"""Period of writing; a kill -9 loses at most about this much."""
SEARCH_PERIOD_NS = SECOND_NS // 2
"""Period of the search for new publishers."""
_LOCKSTEP_NS = 50_000_000
"""In lockstep the recorder is never further behind than this."""


class RecordedTopic(PolledSubscription):
    """One recorded topic: its messages go into the file as they are pulled, and none waits."""

    def __init__(self, recorder: RecorderNode, name: str, typename: str, qos: Qos) -> None:
        spec = TopicSpec(f"/{name}", typename, qos, 0.0, "")
        super().__init__(recorder.ros, spec=spec, depth=DEPTH)
        self.name, self.typename, self.qos = name, typename, qos
        self.sequence_counter = SequenceCounter()
        self._recorder = recorder
        self._has_publisher = False

    def relax_qos(self, qos: Qos) -> None:
        """Request less where a publisher doesn't offer the requested quality of service."""
        weaker = weakest_qos((self.qos, qos))
        if weaker != self.qos:
            self.pull()
            self._node.destroy_subscription(self._subscription)
            self.qos = weaker
            self._subscribe(weaker, DEPTH)

    def pull(self) -> None:
        """Record all received messages."""
        write = self._recorder.sink.write
        item = self._take(self.kind, True)
        if item is not None and not self._has_publisher:
            self._has_publisher = True
            self._recorder.meet(self)
        while item is not None:
            message, info = item
            received = info["received_timestamp"]
            self.sequence_counter.count(info["publication_sequence_number"])
            write(self.name, message, received, info["source_timestamp"] or received)
            self.received += 1
            item = self._take(self.kind, True)


class RecorderNode(LoopNode):
    """Polls the topics, writes the messages, finds new publishers."""

    # By the wall's clock also in simulated time: a recording goes on when that stands still.
    publishes_clock = True

    def __init__(self) -> None:
        super().__init__("recorder", POLLS_HZ, priority=RECORDER)
        self.sim_time = False
        self._started_ns = time.time_ns()
        self._stopped_ns = 0
        self._undescribed: dict[str, str] = {}
        self._sources: dict[str, RecordedTopic] = {}
        for named in self.declare("new_topics", [""], "topics of other cores: name, type"):
            name, _, typename = named.partition(" ")
            if name:
                TOPICS[name] = TopicSpec(name, typename, STATE, 0.0, "of a core")
        known = [name for name in TOPICS if name != CLOCK.name]
        names = self.declare("topics", known, "names of the topics to record")
        self._all = self.declare("all", False, "record every other topic on the graph too")
        vehicles = self.declare("namespaces", [""], "of several vehicles: records topics of each")
        self._several = any(vehicles)
        self._specs = {
            f"/{vehicle}{name}" if vehicle else self._resolved(name): TOPICS.get(name)
            for vehicle in vehicles or [""]
            for name in names
        }
        self.sink = BagSink(self._target(), self._notes, self._records())
        for name, spec in self._specs.items():
            if spec is not None:
                qos = lockstep_spec(spec).qos if self.lockstep else spec.qos
                self._subscribe(name, spec.typename, qos, warn_if_unknown=False)
        self._written_at = self._counted_at = time.monotonic_ns()
        self._searched_at = 0
        self._seen_before = 0
        self._diagnostics_values()
        self.ros.get_logger().info(f"recording to {self.sink.target}")

    def _resolved(self, name: str) -> str:
        """Return a topic's name on the graph: the suite's own move with namespace and remaps."""
        try:
            return str(self.ros.resolve_topic_name(name.lstrip("/") if name in TOPICS else name))
        except Exception as error:  # rclpy's own class, which has no public name
            reason = str(error).partition(", at ")[0]
            raise InputError(f"topics: '{name}': {reason}; accepted: names of topics") from error

    def _target(self) -> Path:
        now = time.strftime("%Y_%m_%d-%H_%M_%S", time.localtime(self._started_ns // SECOND_NS))
        output = self.declare(
            "output",
            "",
            "to make: folder, or file ending in .mcap; empty: recording_ with the time",
        )
        return Path(output or f"recording_{now}").expanduser().absolute()

    def _records(self) -> dict[str, dict[str, str]]:
        """Read the metadata of the file.

        Raises:
            InputError: no such file, or not of that form.
        """
        path = self.declare(
            "metadata_file", "", "JSON: name of a metadata record of the file -> its texts by key"
        )
        if not path:
            return {}
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            return {
                str(name): {str(key): str(value) for key, value in values.items()}
                for name, values in content.items()
            }
        except (OSError, ValueError, AttributeError) as error:
            accepted = "a JSON object of objects of texts"
            raise InputError(f"metadata_file '{path}': {error}; accepted: {accepted}") from error

    def step(self, now_ns: int) -> None:
        """Take the received messages; write, find publishers and report, each at its period."""
        for source in self._sources.values():
            source.pull()
        clock = time.monotonic_ns()
        if clock - self._written_at >= FLUSH_NS:
            self._written_at = clock
            self._guarded(self.sink.flush)
        elif clock - self._searched_at >= SEARCH_PERIOD_NS:
            self._searched_at = clock
            self._discover_publishers()
        elif clock - self._counted_at >= SECOND_NS:
            self._diagnostics_values()

    def lockstep_ticks(self, alone: bool) -> Iterator[bool] | None:
        """Record what each fiftieth tick asks for before the simulator goes on.

        Of several vehicles it takes no part: each has ticks of its own.
        """
        if self._several:
            return None
        inputs = {
            spec.name: self._sources[name]
            for name, spec in self._specs.items()
            if spec is not None and spec.name not in UNCOUNTED and name in self._sources
        }
        member = LockstepMember(self, "recorder", inputs, {}, _LOCKSTEP_NS, False)
        return member.ticks(lambda now_ns, messages: None, self._idle, alone)

    def _idle(self) -> None:
        now_ns = time.time_ns()
        self.step(now_ns)
        self.periodic_tasks(now_ns, now_ns)

    def close(self) -> None:
        """Take the remaining messages, finish the file, log a line about the recording."""
        for source in self._sources.values():
            source.pull()
        self._discover_publishers()
        self._stopped_ns = time.time_ns()
        self._guarded(self.sink.close)
        if self.sink.unwritten:
            self.exit_code = 1
        self._diagnostics_values()
        self._log_summary()

    def _guarded(self, action: Callable[[], None]) -> None:
        """Write; if the disk refuses, report it and end the recording."""
        try:
            action()
        except OSError as error:
            reason = error.strerror or str(error)
            text = f"can't write {self.sink.path}: {reason}; the recording ends"
            self.health.fault("disk", True, text, ERROR)
            self.report(time.time_ns())
            self.exit_code = 1
            self.stop()

    def _discover_publishers(self) -> None:
        """Find new publishers; adapt to their QoS; count them."""
        names = dict.fromkeys(self._specs)
        if self._all:
            names.update(dict.fromkeys(name for name, _ in self.ros.get_topic_names_and_types()))
        for name in names:
            source = self._sources.get(name)
            offers = self.ros.get_publishers_info_by_topic(name)
            if offers and source is None:
                qos = weakest_qos(map(_offered, offers))
                source = self._subscribe(name, offers[0].topic_type, qos)
            if source is not None:
                if offers:
                    self.meet(source, offers)
                source.sequence_counter.publishers(len(offers))

    def meet(self, source: RecordedTopic, offers: Sequence[Any] | None = None) -> None:
        """Take note of a topic's publishers. Now the topic is one of the recording's."""
        if offers is None:
            offers = self.ros.get_publishers_info_by_topic(source.name)
        if offers:
            source.relax_qos(weakest_qos(map(_offered, offers)))
        self.sink.add_topic(source.name, source.typename, source.qos)

    def _subscribe(
        self, name: str, typename: str, qos: Qos, *, warn_if_unknown: bool = True
    ) -> RecordedTopic | None:
        """Begin to record a topic, if its type is installed and can be described."""
        if name in self._undescribed:
            return None
        try:
            type_hash(typename)
            source = self._sources[name] = RecordedTopic(self, name, typename, qos)
        except (InputError, ImportError, AttributeError, ValueError) as error:
            if warn_if_unknown:
                self._undescribed[name] = typename
                reason = str(error).partition("; accepted")[0]
                self.health.fault(
                    f"undescribed.{name}", True, f"{name} is not recorded: {typename}: {reason}"
                )
            return None
        return source

    @property
    def _counters(self) -> dict[str, SequenceCounter]:
        return {name: source.sequence_counter for name, source in self._sources.items()}

    def _diagnostics_values(self) -> None:
        clock = time.monotonic_ns()
        span_s = max(clock - self._counted_at, 1) / SECOND_NS
        self._counted_at = clock
        counters = self._counters
        messages = sum(counter.messages for counter in counters.values())
        for key, value in (
            ("messages", messages),
            ("lost", _lost(counters)),
            ("unwritten", self.sink.unwritten),
            ("rate_hz", round((messages - self._seen_before) / span_s, 1)),
            ("bytes", self.sink.size),
            ("file", str(self.sink.path)),
            ("crowded", " ".join(_crowded(counters))),
        ):
            self.health.value(key, value)
        self._seen_before = messages

    def _notes(self) -> dict[str, str]:
        """Return the recorder's notes in the file."""
        counters = {n: self._sources[n].sequence_counter for n in sorted(self.sink.topics)}
        return {
            "started_ns": str(self._started_ns),
            "stopped_ns": str(self._stopped_ns or ""),
            "messages": str(self.sink.messages),
            "lost": str(_lost(self._counters)),
            "unwritten": str(self.sink.unwritten),
            "crowded": " ".join(_crowded(counters)),
            **{f"lost:{name}": str(counter.lost) for name, counter in counters.items()},
            **{f"undescribed:{name}": kind for name, kind in self._undescribed.items()},
        }

    def _log_summary(self) -> None:
        seconds = (self._stopped_ns - self._started_ns) / SECOND_NS
        counters = [counter for counter in self._counters.values() if counter.messages]
        lost = f"lost {_lost(self._counters)}"
        if self.sink.unwritten:
            lost += f", {self.sink.unwritten} could not be written"
        sys.stdout.write(
            f"recorded {self.sink.messages} messages on {len(counters)} topics in {seconds:.1f} s,"
            f" {lost}, {self.sink.size / 1e6:.1f} MB: {self.sink.target}\n"
        )
        sys.stdout.flush()


def _lost(counters: Mapping[str, SequenceCounter]) -> int:
    return sum(counter.lost for counter in counters.values())


def _crowded(counters: Mapping[str, SequenceCounter]) -> list[str]:
    """List the topics that had more than one publisher."""
    return [name for name, counter in counters.items() if counter.multiple_publishers]


def weakest_qos(offers: Iterable[Qos]) -> Qos:
    """Return the QoS to subscribe with to all of these publishers, at least one.

    DDS connects a subscription only if it asks for no more than a publisher offers. Depth does
    not count there: it is the first one's.
    """
    every = list(offers)
    reliable = all(qos.reliability == "reliable" for qos in every)
    transient_local = all(qos.durability == "transient_local" for qos in every)
    return _qos(every[0].depth, reliable, transient_local)


def _offered(offer: Any) -> Qos:
    """Return the QoS that a publisher offers; discovery does not carry the depth."""
    profile = offer.qos_profile
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    return _qos(profile.depth or Qos().depth, reliable, latched)


def _qos(depth: int, reliable: bool, transient_local: bool) -> Qos:
    return Qos(
        depth,
        "reliable" if reliable else "best_effort",
        "transient_local" if transient_local else "volatile",
    )


main = main_of(RecorderNode)

if __name__ == "__main__":
    main()
