"""Texts of a comparison with healthy flights."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_diagnosis.change.comparison import Comparison, Spread
from tombo_diagnosis.change.features import Features
from tombo_diagnosis.change.signatures import ADDED_WEIGHT, HANGING_LOAD, UNBALANCE, WEAK_PROPELLER
from tombo_diagnosis.change.verdict import ChangeVerdict
from tombo_diagnosis.wording import counted, listed, percent, sized
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


def summary(
    verdict: ChangeVerdict, spread: Spread, comparison: Comparison, seen: Mapping[str, float]
) -> str:
    """Return the verdict in a sentence or two, with figures.

    `seen`: candidate -> the smallest of its sizes that would have been seen (`smallest_seen`).
    """
    day = np.sqrt(np.diag(spread.demand))
    k = int(np.abs(comparison.shift.demand / day).argmax())
    share, usual = np.expm1([comparison.shift.demand[k], day[k]])  # of logarithms
    more = "more" if share > 0.0 else "less"
    told = (
        f"Rotor {ROTOR_NAMES[k].replace('_', ' ')} is asked for {percent(abs(share), 1)} "
        f"{more} thrust than in {counted(spread.flights, 'healthy flight')}, which spread by "
        f"{percent(usual, 1)}; swing {percent(np.expm1(comparison.shift.swing))}."
    )
    if verdict.verdict == "none":
        return f"{told} Healthy flights differ as much. {_would_show(seen)}"
    if verdict.verdict == "unknown":
        first = [
            f"{phrase(f.candidate.label)} ({percent(f.probability)})" for f in verdict.members
        ]
        most = f" Most probable: {listed(first[:4])}." if first else " No candidate explains it."
        return f"{told}{most}"
    said = listed([phrase(m.candidate.label) for m in verdict.members], "or")
    return f"{told} That is what {said} asks for."


def _would_show(seen: Mapping[str, float]) -> str:
    """Return the smallest changes that would have been seen; of rotors, at the worst of them."""
    worst: dict[str, float] = {}
    for label, size in seen.items():
        effect = label.partition(".")[0]
        worst[effect] = max(size, worst.get(effect, 0.0))
    shown = [
        f"{_PHRASES[effect]} from {sized(size, '1')}"
        for effect, size in worst.items()
        if np.isfinite(size)
    ]
    if not shown:
        return "They differ so much that no change at all would have been seen."
    return f"These flights would have shown {listed(shown)}; what is smaller is not seen here."


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
