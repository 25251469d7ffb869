"""Texts of a diagnosis: headline, badge, best gains, next steps."""

from __future__ import annotations

import math
from typing import Final

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.wording import capital, certainty, listed
from tombo_flight.extended_model import Gain

_BADGES: Final = {
    "none": ("no cause found", "good"),
    "named": ("cause named", "good"),
    "set": ("not told apart", "warn"),
    "unknown": ("cause unknown", "bad"),
    "partly_explained": ("partly explained", "warn"),
}
LABELS: Final = {verdict: label for verdict, (label, _) in _BADGES.items()}
"""What is written on the badge of each verdict."""
CLASSES: Final = {verdict: colour for verdict, (_, colour) in _BADGES.items()}
"""How each verdict is coloured: good, warn or bad."""


def causes_title(verdict: str) -> str:
    """Return the heading above the causes."""
    return "What it may be" if verdict == "set" else "What it is"


def badge(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words, with its confidence."""
    return f"{LABELS[diagnosis.verdict]} · {certainty(diagnosis.confidence)}"


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as one sentence in large words."""
    causes = [cause.effect for cause in diagnosis.causes]
    if diagnosis.verdict == "named" and causes:
        several = "The causes are" if len(causes) > 1 else "The cause is"
        return f"{several} {listed(causes, 'and')}"
    if diagnosis.verdict == "set" and diagnosis.set:
        return f"It is {listed(diagnosis.set, 'or')}: these flights can’t tell"
    if diagnosis.verdict == "partly_explained" and causes:
        are = "are" if len(causes) > 1 else "is"
        return f"{capital(listed(causes, 'and'))} {are} part of it; something else is left"
    if diagnosis.verdict == "unknown":
        return "Something is wrong that no known effect explains"
    if diagnosis.verdict == "none":
        return "The simulation agrees with these flights"
    return LABELS[diagnosis.verdict]


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
    blind = [score.effect for score in diagnosis.candidates if not score.excited]
    if diagnosis.verdict == "none" and blind:
        steps = [
            "These flights could not have shown "
            f"{listed(blind[:6], 'or' if len(blind) <= 6 else 'and')}"
            f"{f' and {len(blind) - 6} others' if len(blind) > 6 else ''}: if you suspect one, "
            "fly what excites it (remarks in the table of candidates)."
        ]
    return steps


def best_gains(diagnosis: Diagnosis, most: int = 3) -> list[Gain]:
    """Return the channels that gained most, one entry each, most likely to matter first."""
    found: dict[str, Gain] = {}

    def certain(gain: Gain) -> tuple[bool, float]:
        """Return the lower end of the reduction; those that have one come first."""
        best = gain.low if math.isfinite(gain.low) else gain.reduction
        return math.isfinite(gain.low), best if math.isfinite(best) else -math.inf

    for gain in sorted(diagnosis.gain, key=certain, reverse=True):
        found.setdefault(gain.channel, gain)
    return [gain for gain in found.values() if gain.reduction > 0.0][:most]
