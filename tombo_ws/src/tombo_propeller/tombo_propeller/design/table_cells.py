"""What a table shows of a candidate: its name, its figures, how they are known."""

from __future__ import annotations

import math

from tombo_propeller.design.candidates import describe, short
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_files import is_built_in
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import MEASURED, QUANTITIES, Quantity

EVIDENCE = ("measured", "predicted within what was tested", "extrapolated")
"""What the figures of a candidate rest on, by tier."""
KEY = "* measured; ≤ upper end of a prediction; ? outside of what was tested; others modelled"
"""What the marks of `cell` mean."""
_UNFLOWN = "keeps to all limits, not flown"
"""A candidate that might break its claims in flight, as others do that keep to the limits."""


def name_of(found: Design, index: int) -> str:
    """Return a candidate's name: its number where the library has one."""
    configuration = found.judged.configurations[index]
    if configuration.measured is not None or is_built_in(configuration):
        return f"Conf. {configuration.number}"
    return describe(configuration)


def label_of(found: Design, index: int) -> str:
    """Return a candidate's name for a table."""
    name, configuration = name_of(found, index), found.judged.configurations[index]
    return short(configuration) if name == describe(configuration) else name


def figure(value: float, quantity: Quantity) -> str:
    """Return a figure as it is shown; a dash if unknown."""
    if not math.isfinite(value):
        return "-"
    digits = {"N": 0, "dB": 1}.get(quantity.unit, 2)
    return f"{value:.{digits}f}"


def known(found: Design, index: int, column: int) -> str:
    """Return how a figure is known, with the interval of a prediction."""
    judged = found.judged
    label = judged.labels[index][column]
    low, high = float(judged.low[index, column]), float(judged.high[index, column])
    if not math.isfinite(low) or not high > low:
        return f"{label}{' in speed' if QUANTITIES[column].name not in MEASURED else ''}"
    quantity = QUANTITIES[column]
    return f"{label}, {figure(low, quantity)} to {figure(high, quantity)}"


def cell(found: Design, index: int, column: int) -> str:
    """Return a figure for a table: `*` where it is measured, the upper end where predicted."""
    judged, quantity = found.judged, QUANTITIES[column]
    text = figure(float(judged.value[index, column]), quantity)
    if judged.labels[index][column] == "measured":
        return f"{text}*"
    high = float(judged.high[index, column])
    if high > judged.low[index, column]:
        doubt = "?" if judged.labels[index][column] == "extrapolated" else ""
        return f"≤{figure(high, quantity)}{doubt}"
    return text


def shown(found: Design, made: Recommendation) -> list[tuple[int, str]]:
    """Return the candidates that a table shows and what is to be said of each."""
    rows = [] if made.index is None else [(made.index, "recommended")]
    rows += [(index, "fails in flight") for index, _ in made.failed]
    rows += alternatives(found, made)
    there = {index for index, _ in rows}
    tiers = found.judged.tier
    for index in range(len(tiers)):
        if tiers[index] == 0 and index not in there:
            rows.append((index, broken_by(found, index) or _UNFLOWN))
    return rows


def alternatives(found: Design, made: Recommendation, most: int = 3) -> list[tuple[int, str]]:
    """Return others worth a look: index and what they break; those that fit were not flown."""
    skip = {made.index, *(i for i, _ in made.failed)}
    feasible = [i for i in found.choice.order if i not in skip][:most]
    chosen = [(i, _UNFLOWN) for i in feasible]
    chosen += [(i, broken_by(found, i)) for i in found.choice.nearest]
    return chosen


def broken_by(found: Design, index: int) -> str:
    """Return which limits a candidate breaks, and which are unknown."""
    pairs = [
        (limit.quantity.words, slack)
        for limit, slack in zip(found.choice.limits, found.choice.slack[index], strict=True)
        if slack < 0.0
    ]
    broken = " and ".join(name for name, slack in pairs if math.isfinite(slack))
    unknown = " and ".join(name for name, slack in pairs if not math.isfinite(slack))
    parts = [f"breaks {broken}" if broken else "", f"{unknown} unknown" if unknown else ""]
    return "; ".join(part for part in parts if part)
