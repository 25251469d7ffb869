"""PX4's words: its events as texts, explained by its own file, or else by words of ours.

PX4 sends STATUSTEXT only on links on which it hears a ground station; EVENT comes on every link.
The file is read from the vehicle while it is on the ground.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from typing import Any

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.decoded_messages import Severity, StatusText, VehicleEvent
from tombo_px4.link.event_definitions import (
    ARMING_DENIED,
    CHECKS_BEGIN,
    CHECKS_END,
    KNOWN_NUMBERS,
    BadMetadata,
    EventDefinition,
    definitions,
    event_number,
    events_file,
    path_of,
    unpacked,
)
from tombo_px4.link.extra_messages import COMPONENT_METADATA
from tombo_px4.link.file_transfer import FileAnswer, FileReader
from tombo_px4.link.message_encoder import MessageTarget, request_message, run_checks

_AGAIN_NS = SECOND_NS
_TRIES = 3


_Steps = Generator[list[Any], int, Any]
"""Steps of reading: each yields what to send, and gets the time of the next one [ns]."""


class MetadataReader:
    """COMPONENT_METADATA names a general file, that one the file of events.

    Attributes:
        events: read from the file, by number; empty where the vehicle explains none.
        failed: why it explains none; empty as long as it may.
        over: nothing more is read.
    """

    def __init__(self, to: MessageTarget) -> None:
        self._to = to
        self.reset()

    def reset(self) -> None:
        """Begin again, with another vehicle or after its restart."""
        self.events: dict[int, EventDefinition] = {}
        self.failed, self.over = "", False
        self._uri: str | None = None
        self._file: FileReader | None = None
        self._steps = self._read()
        next(self._steps)

    def take_uri(self, uri: str) -> None:
        """Take COMPONENT_METADATA."""
        self._uri = uri

    def take_answer(self, answer: FileAnswer) -> None:
        """Take an answer of the vehicle's MAVLink FTP."""
        if self._file is not None:
            self._file.take(answer)

    def tick(self, now_ns: int, on_ground: bool) -> list[Any]:
        """Return what to send now; off the ground nothing is read, and it begins again after."""
        if self.over:
            return []
        if on_ground:
            return self._steps.send(now_ns)
        closing = [] if self._file is None else self._file.close()
        self.reset()
        return closing

    def _read(self) -> _Steps:
        try:
            uri = yield from self._ask()
            general = yield from self._read_file(path_of(uri))
            self.events = definitions((yield from self._read_file(events_file(general))))
        except BadMetadata as error:
            self.failed = str(error)
        self.over = True
        yield []

    def _ask(self) -> _Steps:
        """Ask where the general file is."""
        now_ns = yield []
        for _ in range(_TRIES):
            asked_ns = now_ns
            now_ns = yield [request_message(self._to, COMPONENT_METADATA)]
            while self._uri is None and 0 <= now_ns - asked_ns < _AGAIN_NS:
                now_ns = yield []
            if self._uri is not None:
                return self._uri
        raise BadMetadata("it has no COMPONENT_METADATA")

    def _read_file(self, path: str) -> _Steps:
        """Return what a file contains, unpacked."""
        if not path:
            raise BadMetadata("its metadata are not on the vehicle")
        file = self._file = FileReader(path, self._to)
        now_ns = yield []
        while not file.over:
            now_ns = yield file.tick(now_ns)
        yield file.close()
        self._file = None
        if file.content is None:
            raise BadMetadata(file.failed)
        return unpacked(file.content)


_BEGIN, _END = event_number(CHECKS_BEGIN), event_number(CHECKS_END)
_DENIED = event_number(ARMING_DENIED)
_OFFBOARD_BIT = 1 << 14
"""NAVIGATION_STATE_OFFBOARD among the modes of a check: the mode in which the bridge arms."""
_MOST_WAITING = 64
_SHOWN_ARGUMENTS = 16


class VehicleWords:
    """Turns events into texts. Those that come before PX4's file is read wait for it.

    Attributes:
        metadata: reads that file.
        checks: what stands in the way of arming in OFFBOARD, as PX4 reported last.
    """

    def __init__(self, to: MessageTarget) -> None:
        self._to = to
        self.metadata = MetadataReader(to)
        self.checks: tuple[str, ...] = ()
        self._waiting: deque[VehicleEvent] = deque(maxlen=_MOST_WAITING)
        self._report: list[StatusText] | None = None
        self._asks = self._asked = False
        self._reported_texts: set[str] = set()

    def reset(self) -> None:
        """Begin again after a restart of the vehicle."""
        self.metadata.reset()
        self._waiting.clear()
        self._report, self.checks = None, ()
        self._asks = self._asked = False
        self._reported_texts.clear()

    def take(self, event: VehicleEvent) -> None:
        """Take an event; its text comes from `tick`."""
        self._waiting.append(event)

    @property
    def explained(self) -> bool:
        """PX4's file has been read: texts that are events too need not be said twice."""
        return bool(self.metadata.events)

    def tick(
        self, now_ns: int, on_ground: bool, flies: bool
    ) -> tuple[list[Any], list[StatusText]]:
        """Return what to send, and the texts that are new.

        Args:
            now_ns: the present.
            on_ground: the vehicle is there and disarmed.
            flies: it is armed: nothing waits for PX4's file any longer.
        """
        settled = self.metadata.over
        messages = self.metadata.tick(now_ns, on_ground)
        if self.metadata.over and not settled:
            self._asks = True  # what it reported before this link was there
        texts: list[StatusText] = []
        while self._waiting and (self.metadata.over or flies):
            texts += self._texts(self._waiting.popleft())
        if self._asks and on_ground:
            self._asks, self._asked = False, True
            messages.append(run_checks(self._to))
        return messages, texts

    def _texts(self, event: VehicleEvent) -> list[StatusText]:
        if event.number == _BEGIN:
            self._report = []
            return []
        if event.number == _END:
            return self._reported()
        if event.number == _DENIED:
            self._asks = True  # PX4 reports changes only: its reasons may be long ago
        if event.severity > Severity.INFO:
            return []
        definition = self._definition(event.number)
        text = StatusText(event.arrival_ns, event.severity, self._words(event, definition))
        if self._report is None:
            return [text]
        if definition is None or not definition.names_modes or _stands_in_the_way(event):
            self._report.append(text)
        return []

    def _reported(self) -> list[StatusText]:
        """Return the failed checks that are new, or all if they were asked for."""
        report, self._report = self._report or [], None
        self.checks = tuple(text.text for text in report if text.severity <= Severity.ERROR)
        new = [text for text in report if self._asked or text.text not in self._reported_texts]
        self._reported_texts = {text.text for text in report}
        self._asked = False
        return [
            StatusText(text.arrival_ns, text.severity, f"Preflight Fail: {text.text}")
            for text in new
        ]

    def _definition(self, number: int) -> EventDefinition | None:
        return self.metadata.events.get(number) or KNOWN_NUMBERS.get(number)

    def _words(self, event: VehicleEvent, definition: EventDefinition | None) -> str:
        if definition is not None:
            return definition.text(event.arguments)
        arguments = event.arguments.rstrip(b"\0")[:_SHOWN_ARGUMENTS].hex(" ") or "none"
        return f"event {event.number} of component {event.number >> 24}, arguments {arguments}"


def _stands_in_the_way(event: VehicleEvent) -> bool:
    return bool(int.from_bytes(event.arguments[:4], "little") & _OFFBOARD_BIT)
