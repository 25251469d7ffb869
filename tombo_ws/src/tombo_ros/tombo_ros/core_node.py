"""The node that hosts a core: its parameters, topics, faults and loop follow from the core."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from dataclasses import replace
from typing import Any

from std_srvs.srv import Trigger

from tombo_bag.message_codec import MessageCodec, dataclass_of
from tombo_bag.topics import MOCAP_POSE, TOPICS, TopicSpec
from tombo_dynamics.core import Core, CoreRunner
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import neutral
from tombo_dynamics.time_base import SECOND_NS, TICK_NS
from tombo_ros.lockstep import LockstepMember
from tombo_ros.node_loop import LoopNode, run
from tombo_ros.pacing import Priority, sleep_until
from tombo_ros.topic import PolledSubscription, ReceivedMessage

_DEPTH = 200
"""Messages that an input may be behind."""
_MARGIN_NS = 250_000
"""A loop that follows a sensor aims to run this long after a sample has arrived."""
_FOLLOW = 0.02
"""Share of the error from that time that each run corrects."""
_FASTEST_NS = 1000
"""Largest correction of a run: 0.1 % of the rate at 1 kHz."""
_RECHECK_NS, _RECHECKS = 100_000, 4
"""Time between further checks for a late sample, and their number."""
_WARM_UP_TICKS, _WARM_UP_POSE = 120, 30
_ANSWER_S = 2.0
"""Time that the loop has for taking a command."""
LOOP_SILENT = f"the loop has not run for {_ANSWER_S:g} s: the command is withdrawn"
"""Refusal of a command that it has not taken."""


class CoreInput:
    """One input of the core."""

    def __init__(self, spec: TopicSpec, subscription: PolledSubscription) -> None:
        self.topic = spec.name
        self.subscription = subscription
        self.codec = MessageCodec(spec.typename)


def _spec(topic: str) -> TopicSpec:
    """Return a topic by its name; one that the suite does not know has another vehicle's poses."""
    return TOPICS.get(topic) or replace(MOCAP_POSE, name=topic)


class CoreNode(LoopNode):
    """Runs a core on the messages that arrive."""

    def __init__(
        self,
        core: type[Core],
        *,
        rate_hz: float = 0.0,
        priority: Priority | None = None,
        follows: str = "",
    ) -> None:
        """Declare parameters and topics, load compiled code.

        Args:
            core: to host.
            rate_hz: of the loop in real time; 0: by the core's period.
            priority: see `LoopNode`.
            follows: topic of a sensor that is answered first; in real time the loop keeps its
                phase behind the arrival of its samples.

        Raises:
            InputError: a parameter given at the start is refused.
        """
        records = {section: kind() for section, kind in core.sections.items()}
        rate = rate_hz or SECOND_NS / core.period_ns
        super().__init__(core.name, rate, records, fixed=core.fixed, priority=priority)
        self.runs_on_message = core.steps_on_messages
        options = {
            name: self.declare(name, default, doc, read_only=False)
            for name, (default, doc) in core.options.items()
        }
        self.core = core.make(self.records)
        self.core.health = self.health
        for name, value in options.items():
            self.core.set_params(name, value)
        self.core.clock_slack_ns = self.slack_ns
        self.runner = CoreRunner(self.core)
        warm_up(core.make(self.records))
        self.core_inputs = [
            CoreInput(spec, self.subscribe(spec, depth=_DEPTH))
            for spec in map(_spec, self.core.inputs)
        ]
        self._followed = next((i for i in self.core_inputs if i.topic == follows), None)
        self._outputs = {topic: self.advertise(TOPICS[topic]) for topic in core.outputs}
        self._commands: deque[tuple[str, Future[str]]] = deque()  # of the services' thread
        for name in core.commands:
            self.ros.create_service(Trigger, f"~/{name}", self._command_service(name))
        self._late_samples = 0
        self.step_ns = 0
        """Time of the last step."""

    def on_parameters_changed(self, name: str) -> None:
        """Hand a section or an option to the core."""
        value = self.records[name] if name in self.records else self.parameters.get(name)
        self.core.set_params(name, value)

    def _command_service(self, name: str) -> Callable[[Any, Any], Any]:
        """Return the service that hands a command to the loop and waits for its answer."""

        def serve(request: Any, response: Any) -> Any:
            refusal: Future[str] = Future()
            self._commands.append((name, refusal))
            wait([refusal], _ANSWER_S)
            # a command that was reported as refused is not obeyed later
            text = LOOP_SILENT if refusal.cancel() else refusal.result()
            response.success, response.message = not text, text
            return response

        return serve

    def periodic_tasks(self, wall_ns: int, now_ns: int) -> None:
        """Obey commands, besides what every node does."""
        while self._commands:
            name, refusal = self._commands.popleft()
            if refusal.set_running_or_notify_cancel():
                refusal.set_result(self.core.command(name))
        super().periodic_tasks(wall_ns, now_ns)

    def on_published(self, topic: str, message: Any) -> None:
        """Hook: called with each message that the core has published."""

    def step(self, now_ns: int) -> None:
        """Hand over the received messages in the order of the inputs, step, publish.

        A sensor that is followed comes first in real time: other messages count for its next
        sample.
        """
        others = self.core_inputs
        followed = self._followed
        if followed is not None and not self.sim_time:
            samples = self._wait_for(followed.subscription)
            if samples:
                self._follow(now_ns - samples[-1].received_ns)
                self._late_samples += len(samples) - 1
            self.step_core(self._deliver_messages([(followed, samples)]))
            others = [source for source in others if source is not followed]
        present_ns = self._deliver_messages(
            [(source, source.subscription.take_raw()) for source in others]
        )
        if others is self.core_inputs:
            self.step_core(present_ns)

    def lockstep_ticks(self, alone: bool) -> Iterator[bool]:
        """Run the ticks that the simulator gives, again and again."""
        kind = type(self.core)
        member = LockstepMember(
            self,
            kind.name,
            {source.topic: source.subscription for source in self.core_inputs},
            self._outputs,
            kind.period_ns,
            kind.steps_on_messages,
        )
        return member.ticks(self._step_lockstep, self._idle, alone)

    def _step_lockstep(self, now_ns: int, messages: list[list[ReceivedMessage]]) -> None:
        self._now_ns = now_ns
        for source, taken in zip(self.core_inputs, messages, strict=True):
            for received in taken:
                self.decode(source, received.message, now_ns)
        self.runner.hand_over(now_ns)
        self.step_core(now_ns)

    def _idle(self) -> None:
        self.periodic_tasks(time.time_ns(), self._now_ns)

    def _deliver_messages(
        self, taken: Sequence[tuple[CoreInput, Sequence[ReceivedMessage]]]
    ) -> int:
        """Hand messages to the core, each with the time at which it was received.

        Simulated time knows no such time: there the clock is read after the messages, so that none
        is from the future because the loop was interrupted in between.

        Returns:
            the present, which no message is later than.
        """
        wall_ns = time.time_ns()  # receptions are stamped by the system's clock
        now_ns = self.present_ns()
        for source, messages in taken:
            several = source.subscription.multiple_publishers(wall_ns)
            if several != (source.topic in self.core.contested):
                self.core.set_multiple_publishers(source.topic, several)
            for received in messages:
                when_ns = now_ns if self.sim_time else received.received_ns
                self.decode(source, received.message, when_ns)
        self.runner.hand_over(now_ns)
        return now_ns

    def decode(self, source: CoreInput, data: bytes, arrival_ns: int) -> None:
        """Decode a message for the core; report one that is refused."""
        try:
            message = source.codec.decode(data)
        except InputError as error:
            name = source.topic.strip("/")
            self.health.report_event(f"refused.{name}", f"{name}: {error}")
            return
        self.runner.take(source.topic, message, arrival_ns)

    def step_core(self, now_ns: int) -> None:
        """Step the core and publish."""
        self.step_ns = now_ns
        for topic, message in self.core.step(now_ns):
            self._outputs[topic].send(message)
            self.on_published(topic, message)

    def _wait_for(self, source: PolledSubscription) -> list[ReceivedMessage]:
        """Return the received samples; wait a short time for a late one."""
        samples = source.take_raw()
        for _ in range(0 if source.last_ns is None else _RECHECKS):
            if samples:
                break
            sleep_until(time.monotonic_ns() + _RECHECK_NS)
            samples = source.take_raw()
        return samples

    def _follow(self, age_ns: int) -> None:
        """Move the next deadline so that it falls a margin after a sample's arrival."""
        off = (_MARGIN_NS - age_ns + self.late_ns + self.period_ns // 2) % self.period_ns
        shift = int(_FOLLOW * (off - self.period_ns // 2))
        self.shift_ns = min(max(shift, -_FASTEST_NS), _FASTEST_NS)

    def report(self, now_ns: int) -> None:
        """Add `gyro_late`: samples that waited for a later step, as two came between steps."""
        if self._followed is not None:
            self.health.value("gyro_late", self._late_samples)
        super().report(now_ns)


def warm_up(core: Core) -> None:
    """Load all compiled code of a core before its first message, by a short run."""
    kinds = [(topic, dataclass_of(TOPICS[topic].typename)) for topic in core.inputs]
    for tick in range(_WARM_UP_TICKS):
        now_ns = SECOND_NS + tick * TICK_NS
        for topic, kind in kinds:
            if topic != "/mocap/pose" or tick % _WARM_UP_POSE == 0:
                core.on(topic, neutral(kind, now_ns), now_ns)
        core.step(now_ns)


class main_of:
    """The main function of a node."""

    def __init__(self, make: Callable[[], LoopNode]) -> None:
        self.make = make
        """Makes the node, for a process that hosts it with others."""

    def __call__(self, argv: Sequence[str] | None = None) -> None:
        """Run the node."""
        sys.exit(run(self.make, argv))
