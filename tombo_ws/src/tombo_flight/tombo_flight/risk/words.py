"""A result in sentences, for who decides about a flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Result = Mapping[str, Any]
_GOOD_FIT = 0.5


def answer_words(result: Result) -> str:
    """Return the answer in a sentence or two."""
    flights = f"{result['flights']} simulated flights of {result['scenario']}"
    if result["probability"] is None:
        return (
            f"No crash was found in {flights}. With 95 % confidence the probability of a crash "
            f"is below {percent(result['high'])} ({one_in(result['high'])})."
        )
    return (
        f"About {one_in(result['probability'])} crashes: probability "
        f"{percent(result['probability'])}, with 95 % confidence between "
        f"{percent(result['low'])} and {percent(result['high'])}, from {flights}."
    )


def decision_words(result: Result) -> list[str]:
    """Return what decides, in sentences."""
    lines = []
    for row in result["crashes"]:
        lines.append(
            f"Crashes lie at {row['key']} = {row['value']:.4g} on average, "
            f"{abs(row['deviations']):.1f} standard deviations "
            f"{'above' if row['deviations'] > 0.0 else 'below'} the median."
        )
    found = result["influence"]
    if found is None:
        return lines
    if found["indices"]:
        shares = ", ".join(f"{row['key']} {row['total']:.2f}" for row in found["indices"])
        lines.append(
            f"Of what the uncertain settings do to the margin, each has a share of (total Sobol "
            f"index): {shares}."
        )
    little = " The indices say little then; where the crashes lie says more."
    lines.append(
        f"A fitted polynomial of these settings predicts {100.0 * max(found['r2'], 0.0):.0f} % of "
        "the margin's variance in flights that it was not fitted to; the rest comes from sensor "
        "noise, gusts and scatter, or is too irregular for it."
        + little
        * (found["r2"] < _GOOD_FIT)
    )
    return lines


def assumption_words(result: Result) -> list[str]:
    """Return what the answer assumes, in sentences."""
    inputs = [
        f"{one['key']} ~ {one['distribution']} ({one['source']})" for one in result["inputs"]
    ]
    lines = [
        f"The settings vary independently as said: {'; '.join(inputs) or 'none varies'}.",
        "All else is as in the scenario; sensor noise, gusts and scatter are drawn anew in each "
        "flight.",
        "A crash is one of the simulation (docs/figures.md says what counts as one); what the "
        "model lacks is not in the figure.",
    ]
    given = result["drawn_as_given"]
    if result["method"] == "adaptive" and result["probability"] is not None:
        lines.append(
            "The interval holds if the search has met every way to crash. The "
            f"{given['flights']} flights that were drawn as given, {given['crashed']} of them "
            f"crashed, say without that assumption: below {percent(given['high'])}."
        )
    if result["not_flown"]["flights"]:
        lines.append(
            f"{result['not_flown']['flights']} flights could not be flown and count as crashes; "
            f"the first: {result['not_flown']['first']}"
        )
    return lines


def percent(share: float) -> str:
    """Return a probability in percent, with two digits."""
    return f"{100.0 * share:.2g} %"


def one_in(share: float) -> str:
    """Return a probability as "one flight in N"."""
    if share >= 0.5:
        return "every second flight or more"
    digits = 1 - int(math.log10(1.0 / share))
    return f"one flight in {round(1.0 / share, digits):.0f}"
