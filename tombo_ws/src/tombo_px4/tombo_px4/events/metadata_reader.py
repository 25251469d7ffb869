"""Reads from a vehicle the file that explains its events, while it is on the ground."""

from __future__ import annotations

from typing import Any

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.events.event_definitions import (
    BadMetadata,
    EventDefinition,
    definitions,
    events_file,
    path_of,
    unpacked,
)
from tombo_px4.link.added_messages import COMPONENT_METADATA
from tombo_px4.link.file_transfer import FileAnswer, FileReader
from tombo_px4.link.message_encoder import MessageTarget, request_message

_AGAIN_NS = SECOND_NS
_TRIES = 3


class MetadataReader:
    """COMPONENT_METADATA names a general file, that one the file of events.

    Attributes:
        found: the events, by number; empty where the vehicle explains none.
        failed: why it explains none; empty as long as it may.
        over: nothing more is read.
    """

    def __init__(self, to: MessageTarget) -> None:
        self._to = to
        self.reset()

    def reset(self) -> None:
        """Begin again, with another vehicle or after its restart."""
        self.found: dict[int, EventDefinition] = {}
        self.failed = ""
        self.over = False
        self._file: FileReader | None = None
        self._in_general = True
        self._asked_ns: int | None = None
        self._tries = 0

    def take_uri(self, uri: str) -> None:
        """Take COMPONENT_METADATA."""
        if self._file is None and not self.over:
            self._begin(path_of(uri))

    def take_answer(self, answer: FileAnswer) -> None:
        """Take an answer of the vehicle's MAVLink FTP."""
        if self._file is not None:
            self._file.take(answer)

    def tick(self, now_ns: int, on_ground: bool) -> list[Any]:
        """Return what to send now; off the ground nothing is read, and it begins again after."""
        if self.over:
            return []
        if not on_ground:
            closing = [] if self._file is None else self._file.close()
            self.reset()
            return closing
        if self._file is None:
            return self._ask(now_ns)
        closing = self._finish(self._file)
        return closing or ([] if self._file is None or self.over else self._file.tick(now_ns))

    def _ask(self, now_ns: int) -> list[Any]:
        if self._asked_ns is not None and 0 <= now_ns - self._asked_ns < _AGAIN_NS:
            return []
        if self._tries >= _TRIES:
            self._give_up("it has no COMPONENT_METADATA")
            return []
        self._tries += 1
        self._asked_ns = now_ns
        return [request_message(self._to, COMPONENT_METADATA)]

    def _finish(self, file: FileReader) -> list[Any]:
        """Use a file that is read; return the message that closes it."""
        if file.failed:
            self._give_up(file.failed)
        if not file.over:
            return []
        closing = file.close()
        if file.content is None:
            return closing
        try:
            content = unpacked(file.content)
            if self._in_general:
                self._in_general = False
                self._begin(events_file(content))
            else:
                self.found = definitions(content)
                self.over = True
        except BadMetadata as error:
            self._give_up(str(error))
        return closing

    def _begin(self, path: str) -> None:
        if path:
            self._file = FileReader(path, self._to)
        else:
            self._give_up("its metadata are not on the vehicle")

    def _give_up(self, why: str) -> None:
        self.failed, self.over = why, True
