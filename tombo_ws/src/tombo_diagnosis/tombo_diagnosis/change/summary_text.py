"""Texts of a comparison with healthy flights."""

from __future__ import annotations

import numpy as np

from tombo_diagnosis.change.comparison import Comparison, Spread
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.signatures import ADDED_WEIGHT, HANGING_LOAD, UNBALANCE, WEAK_PROPELLER
from tombo_diagnosis.change.verdict import ChangeVerdict
from tombo_diagnosis.wording import counted, listed, percent
from tombo_dynamics.vehicle import ROTOR_NAMES

_PHRASES = {
    WEAK_PROPELLER: "a weak propeller",
    ADDED_WEIGHT: "a weight",
    HANGING_LOAD: "a hanging load",
    UNBALANCE: "a propeller out of balance",
    "mass_error": "another mass, or another thrust of all propellers",
    "cog_offset": "another centre of gravity",
}


def phrase(label: str) -> str:
    """Return a candidate in words."""
    effect, _, rotor = label.partition(".")
    name = _PHRASES.get(effect, effect.replace("_", " "))
    if not rotor:
        return name
    return f"{name} at rotor {rotor.replace('_', ' ').replace('+', ' and at rotor ')}"


def headline(verdict: str, labels: tuple[str, ...]) -> str:
    """Return the verdict as one sentence in large words."""
    if verdict == "none":
        return "Nothing has changed that these flights show"
    if verdict == "unknown":
        return "Something has changed; these flights do not tell what"
    said = [phrase(label) for label in labels]
    return f"What has changed: {listed(said, 'or')}"


def summary(verdict: ChangeVerdict, spread: Spread, comparison: Comparison) -> str:
    """Return the verdict in a sentence or two, with figures."""
    shift = comparison.shift.demand
    day = np.sqrt(np.diag(spread.demand))
    k = int(np.abs(shift / day).argmax())
    more = "more" if shift[k] > 0.0 else "less"
    seen = (
        f"Rotor {ROTOR_NAMES[k].replace('_', ' ')} is asked for {percent(abs(shift[k]), 1)} "
        f"{more} thrust than in {counted(spread.flights, 'healthy flight')}, which spread by "
        f"{percent(day[k], 1)}; swing {percent(np.expm1(comparison.shift.swing))}."
    )
    if verdict.verdict == "none":
        return f"{seen} Healthy flights differ as much."
    if verdict.verdict == "unknown":
        first = [
            f"{phrase(f.candidate.label)} ({percent(f.probability)})" for f in verdict.members
        ]
        most = f" Most probable: {listed(first[:4])}." if first else " No candidate explains it."
        return f"{seen}{most}"
    said = listed([phrase(m.candidate.label) for m in verdict.members], "or")
    return f"{seen} That is what {said} asks for."


def notes(spread: Spread, new: Features) -> tuple[str, ...]:
    """Return what can't be certified."""
    n = spread.flights
    found = [
        f"With {counted(n, 'healthy flight')} a false alarm below {percent(1.0 / (n + 1.0))} "
        f"can't be certified, so no confidence is above {percent(n / (n + 1.0))}; fly healthy "
        "flights on more days.",
        "In hover a weight beside a rotor and a weak propeller there ask for nearly the same "
        "commands. Exchange the propeller: a weight stays, a weak propeller goes.",
        "All new flights are taken to be in one state; a battery that sits elsewhere looks like "
        "another centre of gravity.",
    ]
    if not np.isfinite(new.shake).all() or not np.isfinite(spread.shake).all():
        found.append("Commands or accelerations are sampled too slowly to show unbalance.")
    return tuple(found)
