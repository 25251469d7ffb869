"""What a core is: the pure part of a node. Messages in, messages out, time as an argument.

A core is run by the headless flight, by the node that hosts it and by the replay, which all read
the same wiring (`tombo_flight.wiring`). Between cores a message of tick k is there at tick k + 1;
what the simulator's sensors measure at tick k is there at tick k.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from tombo_dynamics.time_base import SECOND_NS

WARN, ERROR = 1, 2
"""Levels of a fault."""
CLOCK_SET_BACK_NS = SECOND_NS
"""A clock that has gone back by more than this was set: another flight begins."""
START_GRACE_NS = 10 * SECOND_NS
"""Nodes start in any order: before its first message an input may be silent for so long."""


@dataclass
class CoreHealth:
    """What a core reports of itself; whoever runs it takes it from here."""

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
        taken, self.events = self.events, []
        return taken


class Core(ABC):
    """Takes messages, decides, returns messages. Reads no clock; all times are of one clock."""

    name: ClassVar[str]
    """Name of its node."""
    inputs: ClassVar[tuple[str, ...]]
    """Topics that it takes, in the order in which those of one tick are handed over."""
    outputs: ClassVar[tuple[str, ...]]
    """Topics that it publishes."""
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
    """What an operator may tell it, name → meaning; `command` takes them."""
    clock_slack_ns: int = 0
    """How far the present may be ahead of `now_ns`: a /clock that is published now and then."""

    def __init__(self) -> None:
        self.health = CoreHealth()
        self.contested: set[str] = set()
        """Topics with more than one publisher: which is true is unknown."""

    @classmethod
    @abstractmethod
    def make(cls, records: Mapping[str, Any]) -> Core:
        """Return a new core with the records of its `sections`."""

    @abstractmethod
    def on(self, topic: str, message: Any, now_ns: int) -> None:
        """Take a message (of `tombo_dynamics.messages`) that is there at `now_ns`."""

    @abstractmethod
    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on to `now_ns`; return (topic, message) of all that is to be published, in order."""

    def set_params(self, section: str, params: Any) -> None:  # noqa: B027 - a hook
        """Take another record of a section, or another value of an option; the state stays."""

    def command(self, name: str) -> str:
        """Obey an operator: one of `commands`; return why not, empty where it is obeyed."""
        return f"{self.name} has no command {name}"

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Take note that more than one publisher is on a topic, or no longer."""
        (self.contested.add if several else self.contested.discard)(topic)
