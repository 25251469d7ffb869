"""One thing found before take-off, in words that name cause and cure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class FindingSeverity(IntEnum):
    """How much a finding matters."""

    ADVICE = 0
    WARNING = 1
    BLOCKS = 2
    """The bridge does not arm with it."""


@dataclass(frozen=True)
class Finding:
    """What is wrong, why, and what to do about it."""

    key: str
    text: str
    weight: FindingSeverity = FindingSeverity.BLOCKS
