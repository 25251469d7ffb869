"""A diagnosis in words: headline, figures with their intervals, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_flight.extended_model import FittedParameter, Gain

DASH: Final = "–"

LABELS: Final = {
    "none": "no cause found",
    "named": "cause named",
    "set": "not told apart",
    "unknown": "cause unknown",
    "partly_explained": "partly explained",
}
"""What is written on the badge of each verdict."""

CLASSES: Final = {
    "none": "good",
    "named": "good",
    "set": "warn",
    "unknown": "bad",
    "partly_explained": "warn",
}
"""How each verdict is coloured: good, warn or bad."""


def badge(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words, with its confidence."""
    return f"{LABELS[diagnosis.verdict]} · {certainty(diagnosis.confidence)}"


def words(name: str) -> str:
    """Return an effect's or channel's name as words."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str) -> str:
    """Return the names as an enumeration that ends with `last` ("and", "or")."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as one sentence in large words."""
    causes = [words(cause.effect) for cause in diagnosis.causes]
    members = [words(name) for name in diagnosis.set]
    if diagnosis.verdict == "named" and causes:
        several = "The causes are" if len(causes) > 1 else "The cause is"
        return f"{several} {listed(causes, 'and')}"
    if diagnosis.verdict == "set" and members:
        return f"It is {listed(members, 'or')}: these flights can’t tell"
    if diagnosis.verdict == "partly_explained" and causes:
        are = "are" if len(causes) > 1 else "is"
        return f"{capital(listed(causes, 'and'))} {are} part of it; something else is left"
    if diagnosis.verdict == "unknown":
        return "Something is wrong that no known effect explains"
    if diagnosis.verdict == "none":
        return "The simulation agrees with these flights"
    return LABELS.get(diagnosis.verdict, words(diagnosis.verdict))


def extends(diagnosis: Diagnosis) -> bool:
    """Return whether something is named, so that the model can be extended."""
    return diagnosis.verdict in ("named", "partly_explained") and bool(diagnosis.causes)


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """Return what to do about the verdict, beside the separating experiment."""
    steps = {
        "named": [
            "Fly once more, at a speed or a height that these flights do not have, and diagnose "
            "it with the extended model: the verdict should be none."
        ],
        "partly_explained": [
            "Use the extended model, and look in the pictures at what is left after it: against "
            "which quantity does it still grow?"
        ],
        "unknown": [
            "Look at the pictures below: against which quantity does the residual grow, and on "
            "which axis? That is the effect to write; docs/effects.md says how.",
            "Check what no candidate covers: a loose part, a cable, another sensor mount, a "
            "changed controller.",
        ],
        "set": ["Fly what separates them; until then do not put either into the model."],
        "none": [],
    }.get(diagnosis.verdict, [])
    blind = [words(score.effect) for score in diagnosis.candidates if not score.excited]
    if diagnosis.verdict == "none" and blind:
        steps = [
            "These flights could not have shown "
            f"{listed(blind[:6], 'or' if len(blind) <= 6 else 'and')}"
            f"{f' and {len(blind) - 6} others' if len(blind) > 6 else ''}: if you suspect one, "
            "fly what excites it (remarks in the table of candidates)."
        ]
    return steps


def percent(share: float, digits: int = 0) -> str:
    """Return a share as a percentage with a typographic minus; a dash for NaN."""
    if not math.isfinite(share):
        return DASH
    return f"{100.0 * share:.{digits}f} %".replace("-", "−").replace("−0 %", "0 %")


def certainty(probability: float) -> str:
    """Return a probability in per cent that never claims to be certain."""
    if not math.isfinite(probability):
        return DASH
    return "> 99 %" if probability > 0.995 else "< 1 %" if probability < 0.005 else percent(
        probability
    )  # fmt: skip


def figure(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, typographic minus; a dash for NaN."""
    if not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if not -4 <= power < 6:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    return f"{value:.{max(digits - 1 - power, 0)}f}".replace("-", "−")


def interval(fitted: FittedParameter) -> tuple[str, str, str]:
    """Return value, low and high with the decimals that the width of the interval allows."""
    width = fitted.high - fitted.low
    if not (math.isfinite(width) and width > 0.0):
        return figure(fitted.value), figure(fitted.low), figure(fitted.high)
    decimals = -math.floor(math.log10(width / 4.0))
    if decimals > 5:
        significant = max(3, 2 + _magnitude(fitted.value) - _magnitude(width))
        return (
            figure(fitted.value, significant),
            figure(fitted.low, significant),
            figure(fitted.high, significant),
        )
    decimals = max(decimals, 0)
    value, low, high = (
        f"{x:.{decimals}f}".replace("-", "−") if math.isfinite(x) else DASH
        for x in (fitted.value, fitted.low, fitted.high)
    )
    return value, low, high


def unit(text: str) -> str:
    """Return a unit as it is set beside a number: nothing for the unit of pure numbers."""
    return "" if text in ("", "1") else text.replace("^2", "²").replace("^3", "³")


def best_gains(diagnosis: Diagnosis, most: int = 3) -> list[Gain]:
    """Return the channels that gained most, one entry each, likeliest to matter first."""
    found: dict[str, Gain] = {}
    for gain in sorted(diagnosis.gain, key=_certain, reverse=True):
        found.setdefault(gain.channel, gain)
    return [gain for gain in found.values() if gain.reduction > 0.0][:most]


def _certain(gain: Gain) -> tuple[bool, float]:
    """Return a key that sorts by the lower end of the reduction; those that have one come last."""
    best = gain.low if math.isfinite(gain.low) else gain.reduction
    return math.isfinite(gain.low), best if math.isfinite(best) else -math.inf


def _magnitude(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0


def capital(text: str) -> str:
    """Return the text with its first letter large, the others as they are."""
    return text[:1].upper() + text[1:]
