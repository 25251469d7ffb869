"""What a field of a message may be, and how often it was not.

A reader of messages returns a record, or the word for why it refuses:

    why = finite(position) or unit_quaternion(attitude) or one_of(frame, (LOCAL_NED,))
    if why:
        return why
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

LOCAL_NED = 1
LOCAL_ENU = 4
LOCAL_OFFSET_NED = 7
BODY_NED = 8
BODY_OFFSET_NED = 9
BODY_FRD = 12
LOCAL_FRD = 20
LOCAL_FLU = 21
"""MAV_FRAME, as far as poses and set points use it."""

_NORM = 0.02
_WORDS = 64


def finite(values: float | Iterable[float], word: str = "not_finite") -> str:
    """Return "" if every number is finite, else the word."""
    numbers = (values,) if isinstance(values, int | float) else values
    return "" if all(math.isfinite(number) for number in numbers) else word


def within(value: float, low: float, high: float, word: str = "out_of_range") -> str:
    """Return "" if `low <= value <= high`, else the word; NaN is never within."""
    return "" if low <= value <= high else word


def all_within(values: Iterable[float], bound: float, word: str = "out_of_range") -> str:
    """Return "" if no number is larger than `bound`, of either sign, else the word."""
    return "" if all(-bound <= value <= bound for value in values) else word


def unit_quaternion(q: Iterable[float], word: str = "not_a_rotation") -> str:
    """Return "" if four numbers are a quaternion of length 1, to 2 %, in any order of parts."""
    numbers = tuple(q)
    square = sum(number * number for number in numbers)
    good = len(numbers) == 4 and (1.0 - _NORM) ** 2 <= square <= (1.0 + _NORM) ** 2
    return "" if good else word


def one_of(value: int, accepted: Collection[int], word: str = "wrong_frame") -> str:
    """Return "" if the number is an accepted one, else the word."""
    return "" if value in accepted else word


class RefusalCounter:
    """Refusals by word: how often, and what the first one said.

    Attributes:
        counts: word → how often.
        texts: word → what was said the first time.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.texts: dict[str, str] = {}
        self._unreported: list[str] = []

    @property
    def total(self) -> int:
        """All refusals."""
        return sum(self.counts.values())

    def refuse(self, word: str, text: str = "") -> None:
        """Count a refusal; "" counts nothing. Words beyond the 64th count as "other"."""
        if not word:
            return
        if word not in self.counts and len(self.counts) >= _WORDS:
            word = "other"
        self.counts[word] = self.counts.get(word, 0) + 1
        if word not in self.texts:
            self.texts[word] = text
            self._unreported.append(word)

    def take_new(self) -> list[tuple[str, str]]:
        """Return (word, first text) of the words that are new since the last call."""
        new = [(word, self.texts[word]) for word in self._unreported]
        self._unreported.clear()
        return new
