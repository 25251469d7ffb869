"""Texts of a diagnosis: headline, badge, leftover, next steps."""

from __future__ import annotations

from typing import Final

from tombo_diagnosis.diagnosis import VARIABLES, Diagnosis, Leftover
from tombo_diagnosis.wording import capital, certainty, listed, percent

_BADGES: Final = {
    "none": ("no cause found", "good"),
    "named": ("cause named", "good"),
    "set": ("not told apart", "warn"),
    "unknown": ("cause unknown", "bad"),
    "partly_explained": ("partly explained", "warn"),
}
STYLES: Final = {verdict: colour for verdict, (_, colour) in _BADGES.items()}
"""How each verdict is coloured: good, warn or bad."""

LEFTOVER_UNITS: Final = {"force": "N", "moment": "N m"}


def dependence_text(left: Leftover) -> str:
    """Return the variables that a leftover follows in flights held out, as sentences."""
    texts = []
    for quantity in left.rms:
        names = [
            f"{VARIABLES[d.variable].text} ({percent(d.r2)})"
            for d in left.dependences
            if d.quantity == quantity
        ]
        texts += [f"{capital(quantity)} follows {listed(names)}."] if names else []
    if not texts:
        return "No variable predicts it in flights held out."
    return f"{' '.join(texts)} In per cent: how much of it is predicted in flights held out."


def badge(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words, with its confidence."""
    return f"{_BADGES[diagnosis.verdict][0]} · {certainty(diagnosis.confidence)}"


def headline(
    diagnosis: Diagnosis, data: str = "these flights", model: str = "The simulation"
) -> str:
    """Return the verdict as one sentence in large words: `data` were compared with `model`."""
    causes = [cause.effect for cause in diagnosis.causes]
    if diagnosis.verdict == "named" and causes:
        several = "The causes are" if len(causes) > 1 else "The cause is"
        return f"{several} {listed(causes, 'and')}"
    if diagnosis.verdict == "set" and diagnosis.set:
        return f"It is {listed(diagnosis.set, 'or')}: {data} can’t tell"
    if diagnosis.verdict == "partly_explained" and causes:
        are = "are" if len(causes) > 1 else "is"
        return f"{capital(listed(causes, 'and'))} {are} part of it; something else is left"
    if diagnosis.verdict == "unknown":
        return "Something is wrong that no known effect explains"
    if diagnosis.verdict == "none":
        return f"{model} agrees with {data}"
    return _BADGES[diagnosis.verdict][0]


NEXT_STEPS: Final = {
    "named": [
        "Fly once more, at a speed or a height that these flights do not have, and diagnose "
        "it with the extended model: the verdict should be none."
    ],
    "partly_explained": [
        "Use the extended model, and look in the pictures at what is left after it: against "
        "which quantity does it still grow?"
    ],
    "unknown": [
        "Look at what is left over: which variable does it follow, and on which axis? That is "
        "the effect to write (CONTRIBUTING.md, Adding an effect).",
        "Check what no candidate covers: a loose part, a cable, another sensor mount, a "
        "changed controller.",
    ],
    "set": ["Measure what separates them; until then do not put either into the model."],
}
"""Verdict → what to do next."""
