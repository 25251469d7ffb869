"""A core: the pure part of a node. Messages in, messages out, time as an argument.

A core is run by the compiled flight, by the node that hosts it and by the replay, which all read
the same wiring (`tombo_sim.wiring`). Between cores a message of tick k is there at tick k + 1; a
measurement of the simulator's sensors at tick k.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, reduce
from operator import itemgetter
from typing import Any, ClassVar

from tombo_dynamics.jit import taking_rows
from tombo_dynamics.message_records import message_of, record_of
from tombo_dynamics.records import Record, fill_record
from tombo_dynamics.time_base import SECOND_NS

WARN, ERROR = 1, 2
"""Levels of a fault."""
CLOCK_SET_BACK_NS = SECOND_NS
"""A clock that has gone back by more than this was set: another flight begins."""
START_GRACE_NS = 10 * SECOND_NS
"""Nodes start in any order: before its first message an input may be silent for so long."""


@dataclass
class CoreHealth:
    """The reports of a core; its host takes them from here."""

    faults: dict[str, tuple[str, int]] = field(default_factory=dict)
    """Faults that are there now: key → (text for a person, level)."""
    events: list[tuple[str, str]] = field(default_factory=list)
    """What went wrong once since it was last taken: (key, text)."""
    values: dict[str, Any] = field(default_factory=dict)
    """Counts and states for the report."""

    def fault(self, key: str, active: bool, text: str = "", level: int = WARN) -> None:
        """Set or clear a fault; the text of the newest call is shown."""
        if active:
            self.faults[key] = (text or key, level)
        else:
            self.faults.pop(key, None)

    def report_event(self, key: str, text: str) -> None:
        """Report something that went wrong once."""
        self.events.append((key, text))

    def refuse(self, key: str, text: str) -> None:
        """Report an input that was not taken, and count it."""
        self.values["refused"] = self.values.get("refused", 0) + 1
        self.report_event(key, text)

    def take_events(self) -> list[tuple[str, str]]:
        """Return the events since the last call."""
        events, self.events = self.events, []
        return events


def no_texts(record: Any) -> Mapping[str, str]:
    """Return the texts of a message that has none."""
    return {}


@dataclass(frozen=True)
class Output:
    """A topic that a core publishes; `due` and `message` are used for compiled cores."""

    kind: type[Any]
    """Of its messages, of `tombo_dynamics.messages`."""
    message: str | Callable[[Any, Any], None] = ""
    """Field of the core's first memory that holds the message, a record with its numbers; or a
    compiled function (memory, record) that writes it, for a large one."""
    due: str = ""
    """Field that says that it is to be published; false from then on."""
    record: type[Record] | None = None
    """Of that field; None: that of `kind`."""
    texts: Callable[[Any], Mapping[str, str]] = no_texts
    """Returns the texts of a message whose record is given: field → text. Missing
    texts are empty, missing frames that of the map."""
    every: int = 1
    """Ticks between two messages, at the least."""
    logged: bool = False
    """The log of a flight has its content: no table of messages is kept of it."""

    @property
    def layout(self) -> type[Record]:
        """The record of a message."""
        return self.record or record_of(self.kind)

    def record_in(self, memory: Any) -> Any:
        """Return the record of the message that is in a core's first memory."""
        if isinstance(self.message, str):
            return field_of(memory, self.message)
        record = self.layout.new()
        self.message(memory, record)
        return record

    def message_of(self, record: Any) -> Any:
        """Return a record as a message."""
        return message_of(self.kind, record, **self.texts(record))


@dataclass(frozen=True)
class Compiled:
    """A core as compiled code runs it. Functions take memories, parameters, then as documented.

    In a tick the core takes messages in the order of `inputs`, and is then stepped if it is due.
    A core without `step` publishes its due messages after each message that it takes; one with
    `step` publishes after the step.
    """

    memories: tuple[str, ...]
    """Names of the core's attributes that it writes, records."""
    params: tuple[str, ...]
    """Names of attributes that it only reads, records or arrays; dots are allowed."""
    takes: Mapping[str, Callable[..., Any]]
    """Topic → function (message, now_ns). A topic that is not in here is handed to the core in
    Python, which is then stepped there."""
    step: Callable[..., Any] | None = None
    """Function (now_ns)."""


def field_of(record: Any, path: str) -> Any:
    """Return the attribute at a dotted path."""
    return reduce(getattr, path.split("."), record)


def as_row(value: Any) -> Any:
    """Return a record, or an array, as the array (1, ...) that it is the element of."""
    return value.as_array() if isinstance(value, Record) else value[None]


_taking_rows = cache(taking_rows)


class Core(ABC):
    """Takes messages, decides, returns messages. Reads no clock; all times are of one clock."""

    name: ClassVar[str]
    """Name of its node."""
    inputs: ClassVar[tuple[str, ...]]
    """Topics that it takes, in the order in which those of one tick are handed over."""
    outputs: ClassVar[Mapping[str, Output]]
    """Topics that it publishes, in the order in which those of one step are."""
    compiled: ClassVar[Compiled | None] = None
    """How compiled code runs it; None: it is run in Python, which costs some 10 us a step."""
    period_ns: ClassVar[int]
    """It is stepped at least so often, at whole multiples of the period."""
    steps_on_messages: ClassVar[bool] = True
    """True: also stepped in a tick in which a message has come; False: messages wait for the next
    multiple of the period, and are handed over just before that step."""
    sections: ClassVar[Mapping[str, type]]
    """Its parameters: section → record."""
    fixed: ClassVar[frozenset[str]] = frozenset({"vehicle", "propeller"})
    """Those of the sections that count at the start only: `set_params` does not take them."""
    options: ClassVar[Mapping[str, tuple[Any, str]]] = {}
    """Further parameters: name → (default, meaning); `set_params` takes them."""
    commands: ClassVar[Mapping[str, str]] = {}
    """Commands of an operator, name → meaning; `command` takes them."""
    clock_slack_ns: int = 0
    """How far the present may be ahead of `now_ns`: a /clock that is published now and then."""

    def __init__(self) -> None:
        self.health = CoreHealth()
        self._published: list[tuple[str, Any]] = []
        self._received: dict[str, Record] = {}
        self.contested: set[str] = set()
        """Topics with more than one publisher: which is true is unknown."""

    @classmethod
    @abstractmethod
    def make(cls, records: Mapping[str, Any]) -> Core:
        """Return a new core with the records of its `sections`."""

    def on(self, topic: str, message: Any, now_ns: int) -> None:
        """Take a message (of `tombo_dynamics.messages`) that is there at `now_ns`.

        A core that does not say otherwise takes it with its compiled function.
        """
        self.take(topic, message, now_ns)

    def take(self, topic: str, message: Any, now_ns: int) -> Any:
        """Hand a message to the compiled function of its topic; return the result."""
        if topic not in self._received:
            self._received[topic] = record_of(type(message)).new()
        record = self._received[topic]
        fill_record(record, message)
        compiled = self.compiled_form()
        rows = (*self._rows(), record.as_array())
        result = _taking_rows(compiled.takes[topic], len(rows))(*rows, now_ns)
        if compiled.step is None:
            self._published += self.take_due()
        return result

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on to `now_ns`; return (topic, message) of all that is to be published, in order."""
        advance = self.compiled_form().step
        if advance is not None:
            rows = self._rows()
            _taking_rows(advance, len(rows))(*rows, now_ns)
        published, self._published = [*self._published, *self.take_due()], []
        return published

    @classmethod
    def compiled_form(cls) -> Compiled:
        """Return what compiled code needs of it.

        Raises:
            TypeError: it runs in Python.
        """
        if cls.compiled is None:
            raise TypeError(f"{cls.name}: runs in Python; accepted: a compiled core")
        return cls.compiled

    def arguments(self) -> tuple[Any, ...]:
        """Return memories and parameters, as its compiled functions take them."""
        compiled = self.compiled_form()
        return tuple(field_of(self, path) for path in (*compiled.memories, *compiled.params))

    def _rows(self) -> tuple[Any, ...]:
        """Return them as arrays, which Python hands to compiled code ten times faster."""
        return tuple(as_row(argument) for argument in self.arguments())

    def take_due(self) -> list[tuple[str, Any]]:
        """Return (topic, message) of all that compiled code has said is due, each once."""
        if self.compiled is None:
            return []
        memory, messages = getattr(self, self.compiled.memories[0]), []
        for topic, output in self.outputs.items():
            above, _, flag = output.due.rpartition(".")
            holder = field_of(memory, above) if above else memory
            if holder[flag]:
                holder[flag] = False
                messages.append((topic, output.message_of(output.record_in(memory))))
        return messages

    def set_params(self, section: str, params: Any) -> None:  # noqa: B027 - a hook
        """Take another record of a section, or another value of an option; the state stays."""

    def command(self, name: str) -> str:
        """Obey an operator: one of `commands`; return why not, empty where it is obeyed."""
        return f"{self.name} has no command {name}"

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Take note that more than one publisher is on a topic, or no longer."""
        (self.contested.add if several else self.contested.discard)(topic)


def step_due(period_ns: int, steps_on_messages: bool, has_messages: bool, now_ns: int) -> bool:
    """Return whether a core is to be stepped at `now_ns`, with the messages that are there."""
    return now_ns % period_ns == 0 or (steps_on_messages and has_messages)


class CoreRunner:
    """Hosts one core: keeps its messages until its step."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self._pending: list[tuple[int, str, Any, int | None]] = []
        self._order = {topic: i for i, topic in enumerate(core.inputs)}

    def take(self, topic: str, message: Any, arrival_ns: int | None = None) -> None:
        """Keep a message that is there from now on; None: its arrival is when the core gets it."""
        if topic in self._order:
            self._pending.append((self._order[topic], topic, message, arrival_ns))

    def hand_over(self, now_ns: int) -> None:
        """Hand the core what is there, in the order of its inputs."""
        for _, topic, message, arrival_ns in sorted(self._pending, key=itemgetter(0)):
            self.core.on(topic, message, now_ns if arrival_ns is None else arrival_ns)
        self._pending.clear()

    def run(self, now_ns: int, due: bool | None = None) -> Sequence[tuple[str, Any]]:
        """Hand over what is there and step, if it is due; return the published messages.

        Args:
            now_ns: the present.
            due: it is, or not, whatever its period says; None: by `step_due`.
        """
        core = self.core
        if due is None:
            due = step_due(core.period_ns, core.steps_on_messages, bool(self._pending), now_ns)
        if not due:
            return ()
        self.hand_over(now_ns)
        return core.step(now_ns)
