"""Why a flight went wrong, as sure as real flights of known mishaps allow."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from tombo_bag.flight import Flight
from tombo_diagnosis.crash.reason import Why, why
from tombo_diagnosis.engine.verdict import succession

_MISHAPS: Final = 19
"""Real flights with a known mishap: 9 of crazyswarm2 (up to flight 149), 10 of air_garage (2024).
Later flights of both were not looked at for this figure."""
_NO_SIGN: Final = 7
"""Of these, how many leave no sign in their logs."""


def judged_why(log: Flight) -> Why:
    """Say why a flight went wrong, as sure as real flights of known mishaps allow.

    A log without a sign is of a sound flight, or of a mishap that leaves none: even odds before.

    Raises:
        InputError: as `why`.
    """
    answer = why(log)
    if answer.cause != "none":
        return answer
    sound = 1.0 / (2.0 - succession(_MISHAPS, _NO_SIGN))
    return replace(answer, confidence=min(answer.confidence, sound))
