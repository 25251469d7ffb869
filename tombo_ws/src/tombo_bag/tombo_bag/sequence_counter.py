"""Counts a topic's messages and its losses."""

from __future__ import annotations


class SequenceCounter:
    """Counts the messages of one topic by the sequence numbers of their publisher.

    The numbers say which message of its publisher this is, but not which publisher. So a gap is a
    loss only while the topic has a single one; what looks like a gap before a second publisher is
    noticed is not counted.
    """

    def __init__(self) -> None:
        self.messages = 0
        self.lost = 0
        self.multiple_publishers = False
        """More than one publisher was present at some time: its losses are not counted."""
        self._last: int | None = None
        self._gaps = 0
        self._shared = False

    def count(self, number: int) -> None:
        """Count a message; a number that is not above the last one is a new publisher's."""
        self.messages += 1
        if self._last is not None and number > self._last:
            self._gaps += number - self._last - 1
        self._last = number

    def publishers(self, number: int) -> None:
        """Say how many publishers the topic has now; to be called now and then, and at the end."""
        if number > 1:
            self.multiple_publishers = self._shared = True
        elif self._shared:
            self._shared = False
            self._last = None
        else:
            self.lost += self._gaps
        self._gaps = 0
