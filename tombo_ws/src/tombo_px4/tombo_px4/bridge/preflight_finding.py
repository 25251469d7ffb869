"""A finding of a preflight check, with cause and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class FindingSeverity(IntEnum):
    """Severity of a finding."""

    ADVICE = 0
    WARNING = 1
    BLOCKS = 2
    """The bridge does not arm while it exists."""


@dataclass(frozen=True)
class Finding:
    """What is wrong, why, and the remedy."""

    key: str
    text: str
    weight: FindingSeverity = FindingSeverity.BLOCKS
