"""A node that is one loop: it takes messages, computes and publishes, at absolute deadlines.

In real time the loop runs at absolute deadlines in the main thread. With `use_sim_time` it runs
when `/clock` moves or a message has come. Parameter services have a thread of their own that
sleeps until a call comes; they never touch the loop's topics. docs/nodes.md has the measurements.
"""

from __future__ import annotations

import gc
import math
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextvars import ContextVar
from operator import attrgetter
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok

from tombo_bag.topics import CLOCK, DIAGNOSTICS, TopicSpec
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_ros.conversion import to_ns
from tombo_ros.health import ERROR, Health
from tombo_ros.loop_statistics import LoopStatistics
from tombo_ros.pacing import Priority, request_realtime_priority, sleep_until
from tombo_ros.qos import lockstep_spec
from tombo_ros.record_parameters import RecordParameters
from tombo_ros.topic import PolledSubscription, TopicPublisher

_CHECK_PERIOD_NS = SECOND_NS // 2
_SETTLE_NS = 2 * SECOND_NS
"""Discovery and first calls; the statistics of a loop begin after it."""
_CLOCK_SILENT_S = 0.5
_ACKNOWLEDGED_S = 1.0
"""Longest wait for subscribers to acknowledge the last messages of a node that ends."""
_LOOK_S = 1e-4
"""Pause of nodes in lockstep that have nothing to do."""
_SLACK_NS = 50_000_000
_POLL_SHARE, _POLL_LEAST_NS, _POLL_MOST_NS = 0.1, 100_000, 1_000_000
"""How often a node in simulated time looks for clock and messages: a tenth of its period."""


NAMESPACE: ContextVar[str] = ContextVar("NAMESPACE", default="")
"""Of the nodes that are made; empty: that of the command line."""


class LockstepError(Exception):
    """A lockstep can't go on, and why."""


class LoopNode(ABC):
    """One node: subclass it, take inputs and publish in `step`."""

    catches_up = False
    """True: missed deadlines are run later; False: they are skipped."""
    runs_on_message = True
    """In simulated time: True runs the loop for each message too, False at its rate alone."""
    publishes_clock = False
    """True: this node publishes /clock; it runs by the wall clock."""
    exit_code = 0
    """Of the process, where the node ends in order."""

    def __init__(
        self,
        name: str,
        rate_hz: float,
        records: Mapping[str, Any] | None = None,
        *,
        fixed: Collection[str] = (),
        priority: Priority | None = None,
    ) -> None:
        """Make the node.

        Args:
            name: of the node.
            rate_hz: of the loop.
            records: section -> record whose fields become parameters.
            fixed: those of its sections that are used at the start only.
            priority: real-time priority to request; not in simulated time.

        Raises:
            InputError: a parameter given at the start is refused.
        """
        self.ros = Node(name, namespace=NAMESPACE.get(), start_parameter_services=True)
        source = getattr(self.ros, "_time_source", None)
        if source is not None:  # the loop polls /clock itself: no callbacks for it
            source.detach_node()
        self.period_ns = round(SECOND_NS / rate_hz)
        self.parameters = RecordParameters(self.ros, records or {}, fixed)
        self.health = Health(self.ros)
        self.reports = PolledSubscription(self.ros, DIAGNOSTICS)
        """Of all nodes; each subscribes. Fast DDS may stop a publisher for 0.33 s at its first
        message to another process: so this is a report, and not a sample in flight."""
        self.loops: dict[str, LoopStatistics] = {"loop": LoopStatistics()}
        """Name of each loop that `/diagnostics` reports -> its statistics."""
        self.late_ns = 0
        """How late this run of the loop is."""
        self.shift_ns = 0
        """Moves the next deadline: a loop that follows another clock sets it."""
        self.deadline_ns = 0
        """Monotonic time of the next run in real time [ns]."""
        self.settles_ns = 0.0
        """Monotonic time from which the loop's statistics count [ns]; inf: they do."""
        self.sim_time = bool(self.ros.get_parameter("use_sim_time").value)
        self.slack_ns = 0
        """How far the present may be ahead of `now_ns`: /clock speaks now and then only."""
        self._priority = None if self.sim_time else priority
        self._inputs: list[PolledSubscription] = []
        self._publishers: list[TopicPublisher] = []
        self.lockstep = self.sim_time and self.declare(
            "lockstep",
            False,
            "with use_sim_time: run exactly the ticks that the simulator gives (all nodes alike)",
        )
        self.lockstep_patience_s = 20.0
        if self.lockstep:
            self.lockstep_patience_s = self.declare(
                "lockstep_patience",
                20.0,
                "wall time [s] after which a node that waits in lockstep ends with an error",
                bounds=(0.1, 3600.0),
            )
        follows = self.sim_time and not self.publishes_clock and not self.lockstep
        if follows:
            self.slack_ns = _SLACK_NS
        self._clock = PolledSubscription(self.ros, CLOCK, depth=1) if follows else None
        self._now_ns = 0
        self._stopping = False
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.ros)
        self._services = threading.Thread(target=self._serve, name="services", daemon=True)
        self._reported_ns = self._checked_ns = 0

    @property
    def records(self) -> dict[str, Any]:
        """Section -> record as it stands."""
        return self.parameters.records

    def subscribe(self, spec: TopicSpec, *, depth: int | None = None) -> PolledSubscription:
        """Subscribe to a topic; the loop polls it."""
        if self.lockstep:
            spec, depth = lockstep_spec(spec), None
        source = PolledSubscription(self.ros, spec, depth)
        self._inputs.append(source)
        return source

    def advertise(self, spec: TopicSpec) -> TopicPublisher:
        """Advertise a topic."""
        made = TopicPublisher(self.ros, lockstep_spec(spec) if self.lockstep else spec)
        self._publishers.append(made)
        return made

    def declare(self, name: str, default: Any, doc: str, **more: Any) -> Any:
        """Declare a parameter of the node's own; see `RecordParameters.declare`."""
        return self.parameters.declare(name, default, doc, **more)

    @abstractmethod
    def step(self, now_ns: int) -> None:
        """Run the loop once, at ROS time `now_ns`."""

    def on_parameters_changed(self, name: str) -> None:  # noqa: B027 - a hook
        """Hook: a section, or a parameter of the node's own, was set."""

    def close(self) -> None:  # noqa: B027 - a hook
        """Hook: called at the end."""

    def stop(self) -> None:
        """End the loop after this run."""
        self._stopping = True

    def now_ns(self) -> int:
        """Return ROS time: the system's clock, or the simulated one."""
        return self._now_ns if self.sim_time else time.time_ns()

    def present_ns(self) -> int:
        """Return ROS time as of this call: in simulated time `/clock` may have moved meanwhile."""
        if self.sim_time:
            self._read_clock()
        return self.now_ns()

    @property
    def stopping(self) -> bool:
        """Whether the loop is to end."""
        return self._stopping or not ok()

    def begin(self) -> None:
        """Answer services from now on, and take the real-time priority."""
        for line in self.parameters.unknown():
            self.health.fault("unknown_parameter", True, line)
        self._services.start()
        served_by = {self._services.native_id or 0}
        scheduling = "normal"
        if self._priority is not None:
            scheduling = request_realtime_priority(self._priority, served_by)
        self.health.value("scheduling", scheduling)
        self.ros.get_logger().info(f"running, scheduling {scheduling}")

    def lockstep_ticks(self, alone: bool) -> Iterator[bool] | None:
        """Run the ticks of a lockstep in parts, and yield after each: other nodes come in between.

        It yields whether there was nothing to do. None: the node runs by the wall's clock.

        Args:
            alone: no other node shares the thread, so it sleeps while it has nothing to do.
        """
        return None

    @property
    def follows_clock(self) -> bool:
        """Whether `/clock` says when it runs."""
        return self._clock is not None

    def run_in_real_time(self, woke: int) -> None:
        """Run once, at or after the deadline, and set the next one; `woke`: the monotonic time."""
        late, period, missed = woke - self.deadline_ns, self.period_ns, 0
        self.late_ns = late
        if late > period:
            missed = 1 if self.catches_up else late // period
            if not self.catches_up:
                self.deadline_ns += missed * period
        if woke > self.settles_ns:
            self.settles_ns = math.inf
            self.loops = {name: LoopStatistics() for name in self.loops}
        self.loops["loop"].ran(woke, late, missed)
        now = time.time_ns()
        self.step(now)
        self.periodic_tasks(now, now)
        self.deadline_ns += period + self.shift_ns
        self.shift_ns = 0

    def spin_simulated(self) -> None:
        """Run when the clock has come to the next run, or a message is there."""
        main = self.loops["loop"]
        poll = round(_POLL_SHARE * self.period_ns)
        poll = min(max(poll, _POLL_LEAST_NS), _POLL_MOST_NS)
        due = 0
        while not self.stopping:
            self._read_clock()
            if due - self._now_ns > self.period_ns + SECOND_NS:  # the clock was set back
                due = 0
            if self._now_ns and (self._now_ns >= due or self._input_waiting()):
                if self._now_ns >= due:
                    main.ran(self._now_ns, 0)
                    due = (self._now_ns // self.period_ns + 1) * self.period_ns
                self.step(self._now_ns)
            else:
                sleep_until(time.monotonic_ns() + poll)
            self.periodic_tasks(time.time_ns(), self._now_ns)

    def _read_clock(self) -> None:
        """Take the newest `/clock`."""
        taken = [] if self._clock is None else self._clock.take_raw()
        if taken and self._clock is not None:
            self._now_ns = to_ns(deserialize_message(taken[-1].message, self._clock.kind).clock)

    def _input_waiting(self) -> bool:
        """Return whether any input has a message, without taking it."""
        return self.runs_on_message and any(source.waiting() for source in self._inputs)

    def periodic_tasks(self, wall_ns: int, now_ns: int) -> None:
        """Do what is not the loop's work: parameters set, publishers counted, reports."""
        for name in self.parameters.changed():
            self.on_parameters_changed(name)
        if wall_ns - self._checked_ns > _CHECK_PERIOD_NS:
            self._checked_ns = wall_ns
            self.health.clear_expired(wall_ns)
            if self._clock is not None:
                silent = self._clock.silent(wall_ns, _CLOCK_SILENT_S)
                self.health.fault("clock_silent", silent, "no /clock: time stands still", ERROR)
            for source in self._inputs:
                self.health.fault(
                    f"second_publisher.{source.topic}",
                    source.multiple_publishers(wall_ns),
                    f"more than one node publishes on {source.topic}",
                )
                if source.unreadable:
                    text = f"messages on {source.topic} that can't be read"
                    self.health.fault(f"unreadable.{source.topic}", True, text)
        elif wall_ns - self._reported_ns > SECOND_NS or self.health.urgent:
            if wall_ns - self._reported_ns > SECOND_NS:
                self._reported_ns = wall_ns
                gc.collect(0)  # the garbage of the last second: some microseconds
            self.report(now_ns)

    def report(self, now_ns: int) -> None:
        """Publish `/diagnostics`."""
        loops = {name: watch.metrics() for name, watch in self.loops.items()}
        self.health.send(now_ns, loops)

    def _serve(self) -> None:
        """Answer parameter calls; sleeps between them."""
        try:
            while not self.stopping:
                self._executor.spin_once(timeout_sec=0.5)
        except ExternalShutdownException:
            return

    def end(self) -> None:
        """Send a last report and leave the graph."""
        self.close()
        self.report(self.now_ns())
        self.destroy()

    def destroy(self) -> None:
        """Take the node off the graph, so that nobody waits for it.

        The last messages of latched topics arrive first: DDS forgets the messages of a publisher
        that ends. Streams are not waited for: they are acknowledged half a second later.
        """
        self._stopping = True
        end_s = time.monotonic() + _ACKNOWLEDGED_S
        for publisher in self._publishers:
            if publisher.spec.qos.durability == "transient_local":
                publisher.wait_for_all_acked(end_s - time.monotonic())
        if self._services.is_alive():
            self._executor.wake()
            self._services.join(timeout=1.0)
        self._executor.shutdown(timeout_sec=0.0)
        self.ros.destroy_node()


def spin_real(nodes: Sequence[LoopNode]) -> None:
    """Run the loops of nodes in this thread, each at its deadlines, the earliest first."""
    began = time.monotonic_ns()
    for node in nodes:
        node.deadline_ns = began + node.period_ns
        node.settles_ns = began + _SETTLE_NS
    while not any(node.stopping for node in nodes):
        due = min(nodes, key=attrgetter("deadline_ns")) if len(nodes) > 1 else nodes[0]
        woke = time.monotonic_ns()
        if woke < due.deadline_ns:
            sleep_until(due.deadline_ns)
            woke = time.monotonic_ns()
        if woke >= due.deadline_ns:  # earlier: a signal came
            due.run_in_real_time(woke)


def spin(nodes: Sequence[LoopNode]) -> None:
    """Run the loops of nodes in this thread until they are told to stop, or ROS is shut down."""
    for node in nodes:
        node.begin()
    gc.collect()
    gc.freeze()
    gc.disable()  # `periodic_tasks` collects new objects, between two runs of the loop
    alone = len(nodes) == 1
    if alone and nodes[0].follows_clock:
        nodes[0].spin_simulated()
        return
    ticks = [node.lockstep_ticks(alone) if node.lockstep else None for node in nodes]
    parts = [part for part in ticks if part is not None]
    if not parts:
        spin_real(nodes)
    while parts:
        waits = [next(part, None) for part in parts]
        parts = [part for part, waiting in zip(parts, waits, strict=True) if waiting is not None]
        if False not in waits:
            time.sleep(_LOOK_S)


def run(
    make: Callable[[], LoopNode | Sequence[LoopNode]], argv: Sequence[str] | None = None
) -> int:
    """Be the main function of a process: start, loop, shut down; return the exit code.

    0 when it was told to stop (SIGINT, SIGTERM, as often as they come), 2 for bad parameters.
    """
    stopped: list[int] = []
    nodes: list[LoopNode] = []

    def ask(number: int, frame: Any) -> None:
        again = bool(stopped)
        stopped.append(number)
        for node in nodes:
            node.stop()
        if not (nodes or again):  # still in the making: compiled code may take its time to load
            raise SystemExit(0)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    try:
        rclpy.init(
            args=sys.argv if argv is None else list(argv),
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except Exception as error:  # rclpy's own classes: wrong command line, unreadable file
        return _refuse(" ".join(str(error).split()))
    code = 0
    try:
        made = make()
        nodes += [made] if isinstance(made, LoopNode) else made
        if not stopped:
            spin(nodes)
    except (InputError, LockstepError) as error:
        code = _refuse(str(error))
    finally:
        for node in nodes:
            node.end()
        rclpy.shutdown()
        for number in (signal.SIGINT, signal.SIGTERM):  # Python is about to forget our handler
            signal.signal(number, signal.SIG_IGN)
    return max([code, *(node.exit_code for node in nodes)])


def _refuse(message: str) -> int:
    print(f"Error: {message}", file=sys.stderr)  # noqa: T201
    return 2
