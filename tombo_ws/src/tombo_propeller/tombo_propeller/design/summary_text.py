"""A design in words: reasons, binding limit, cells of its table."""

from __future__ import annotations

import math

from tombo_dynamics.propeller import RPM
from tombo_propeller.design.candidates import describe
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Recommendation
from tombo_propeller.design.flight_files import is_built_in
from tombo_propeller.design.request import MEASURED, NAMES, QUANTITIES, Criterion, DesignLimit

_BENCH_RPM = 2000.0
"""Speed at which the paper measured thrust and collision force (Table III) [rpm]."""
EVIDENCE = ("measured", "predicted within what was tested", "extrapolated")
"""Basis of the figures of a candidate, by tier."""
KEY = "* measured; ≤ upper end of a prediction; ? outside of what was tested; others modelled"
"""Meaning of the marks of `cell`."""
_UNFLOWN = "keeps to all limits, not flown"
"""A candidate that might break its claims in flight, as others do that keep to the limits."""
_MOST_UNFLOWN = 3


def headline(design: Design, recommendation: Recommendation) -> str:
    """Return the outcome in a line."""
    index = recommendation.index
    if index is not None:
        name, whole = name_of(design, index), describe(design.evaluated.configurations[index])
        return whole if name == whole else f"{name}: {whole}"
    if design.feasible:
        return "Some candidates keep to all limits, but none of those flown recovers as claimed"
    return "No candidate keeps to all limits"


def vehicle_and_limits(design: Design) -> str:
    """Return the vehicle and the limits."""
    limits = ", ".join(limit.text for limit in design.choice.limits)
    request = design.request
    return f"{request.mass_kg:g} kg, arms of {1e3 * request.arm_m:g} mm: {limits}"


def reasons(design: Design, recommendation: Recommendation) -> list[str]:
    """Return why this one: evidence, what binds, who else was tried."""
    evaluated, choice = design.evaluated, design.choice
    counts = [int((choice.feasible & (evaluated.tier == k)).sum()) for k in range(3)]
    split = ", ".join(f"{n} {words}" for n, words in zip(counts, EVIDENCE, strict=True))
    lines = [
        f"{int(choice.feasible.sum())} of {len(evaluated.configurations)} candidates keep to all "
        f"limits ({split})."
    ]
    for failed, check in recommendation.failed:
        broken = "; ".join(
            f"{c.text} {c.simulated:.3g} of {c.claimed:.3g}"
            for c in [c for c in (*check.claims, *check.limits) if not c.held][:2]
        )
        fall = check.largest_fall_m
        more = f", falls up to {fall:.1f} m" if fall > 1.0 else ""
        lines.append(f"Passed over: {name_of(design, failed)}, fails in flight ({broken}{more}).")
    if recommendation.unflown and recommendation.index is None:
        lines.append(
            f"{recommendation.unflown} more keep to the limits and were not flown: like those, or "
            "after too many failures."
        )
    index = recommendation.index
    if index is None:
        return lines
    lines.append(f"It is {EVIDENCE[int(evaluated.tier[index])]}; measured ones go first.")
    k = int(choice.slack[index].argmin())
    limit = choice.limits[k]
    value = figure(evaluated.counted[index, NAMES.index(limit.quantity.name)], limit.quantity)
    spare = choice.slack[index, k]
    lines.append(f"What binds: {limit.text}; it has {value}, {spare:.0%} to spare.")
    if evaluated.operating.motor_limits[index]:
        lines.append("The motor limits its thrust, not the nodus: a stiffer one gains little.")
    else:
        usable = evaluated.operating.usable_speed[index] / RPM
        lines.append(
            f"The nodus limits its thrust: 0.9 of the speed of maximum thrust is {usable:.0f} rpm."
        )
    return lines


def relief_lines(design: Design) -> list[str]:
    """Return which limit must give, and by how much, where nothing keeps to all of them."""
    if design.feasible:
        return []
    lines = []
    for limit, value in zip(design.choice.limits, design.choice.relief, strict=True):
        if value is None:
            continue
        unit = f" {limit.quantity.unit}" if limit.quantity.unit else ""
        lines.append(f"{limit.text}: must be {_reached(value, limit)}{unit}, if the others stay.")
    if not any(value is not None for value in design.choice.relief):
        lines.append("More than one limit has to give; see the nearest candidates.")
    if not design.request.extrapolate:
        lines.append(
            "Collision force, recovery time and noise outside of what was tested count as "
            "unknown; --extrapolate lets their predictions count."
        )
    return lines


def caveats(design: Design, recommendation: Recommendation) -> list[str]:
    """Return the extrapolated and unknown quantities, most important first."""
    index = recommendation.index
    return [
        *([] if index is None else _of_the_recommended(design, index)),
        f"The model's thrust is off by {design.thrust_error:.1%} (RMS) at 2000 rpm, where it was "
        "measured; measured thrust does not follow stiffness.",
        "Collision force is Table III's, one reading each at 2000 rpm. Where the blade is struck "
        "matters as much as which nodus it is: Table II has 136 to 337 N along one blade, at 2500 "
        "rpm.",
        "Noise is at 2000 rpm and 5 m; nobody measured it at the speed of hover.",
    ]


def _of_the_recommended(design: Design, index: int) -> list[str]:
    """Return the caveats that concern the recommended candidate alone."""
    evaluated = design.evaluated
    hover = evaluated.operating.hover_speed[index] / RPM
    top = evaluated.operating.usable_speed[index] / RPM
    lines = []
    if outside := evaluated.outside(index):
        lines.append(f"Outside of what was tested: {'; '.join(outside)}.")
    lines.append(
        f"Hover at {hover:.0f} rpm and the thrust margin at {top:.0f} rpm are the model's: nobody "
        "measured beyond 3200 rpm."
    )
    force = float(evaluated.value[index, NAMES.index("collision_force_N")])
    if math.isfinite(force):
        lines.append(
            f"If the force grows in proportion to speed, {force:.0f} N at 2000 rpm are "
            f"{force * hover / _BENCH_RPM:.0f} N in hover. Nobody measured how it grows."
        )
    return lines


def _reached(value: float, limit: DesignLimit) -> str:
    """Return a value rounded to the side that the limit still lets through."""
    digits = 1 if limit.quantity.unit in ("N", "dB") else 3
    scale = 10**digits
    whole = (
        math.floor(value * scale) if limit.quantity.more_is_better else math.ceil(value * scale)
    )
    return f"{whole / scale:g}"


def name_of(design: Design, index: int) -> str:
    """Return a candidate's name: its number where the library has one."""
    configuration = design.evaluated.configurations[index]
    if configuration.measured is not None or is_built_in(configuration):
        return f"Conf. {configuration.number}"
    return describe(configuration)


def figure(value: float, quantity: Criterion) -> str:
    """Return a figure as it is shown; a dash if unknown."""
    if not math.isfinite(value):
        return "-"
    digits = {"N": 0, "dB": 1}.get(quantity.unit, 2)
    return f"{value:.{digits}f}"


def known(design: Design, index: int, column: int) -> str:
    """Return how a figure is known, with the interval of a prediction."""
    evaluated = design.evaluated
    label = evaluated.labels[index, column]
    low, high = float(evaluated.low[index, column]), float(evaluated.high[index, column])
    if not math.isfinite(low) or not high > low:
        return f"{label}{' in speed' if QUANTITIES[column].name not in MEASURED else ''}"
    quantity = QUANTITIES[column]
    return f"{label}, {figure(low, quantity)} to {figure(high, quantity)}"


def cell(design: Design, index: int, column: int) -> str:
    """Return a figure for a table: `*` where it is measured, the upper end where predicted."""
    evaluated, quantity = design.evaluated, QUANTITIES[column]
    text = figure(float(evaluated.value[index, column]), quantity)
    if evaluated.labels[index, column] == "measured":
        return f"{text}*"
    high = float(evaluated.high[index, column])
    if high > evaluated.low[index, column]:
        doubt = "?" if evaluated.labels[index, column] == "extrapolated" else ""
        return f"≤{figure(high, quantity)}{doubt}"
    return text


def candidates_shown(design: Design, recommendation: Recommendation) -> list[tuple[int, str]]:
    """Return the candidates of a table, with a text for each."""
    rows = [] if recommendation.index is None else [(recommendation.index, "recommended")]
    rows += [(index, "fails in flight") for index, _ in recommendation.failed]
    rows += alternatives(design, recommendation)
    there = {index for index, _ in rows}
    tiers = design.evaluated.tier
    for index in range(len(tiers)):
        if tiers[index] == 0 and index not in there:
            rows.append((index, broken_by(design, index) or _UNFLOWN))
    return rows


def alternatives(design: Design, recommendation: Recommendation) -> list[tuple[int, str]]:
    """Return further candidates to show: index, and `_UNFLOWN` or the limits that it breaks.

    First come up to `_MOST_UNFLOWN` that keep to all limits and were not flown, the best first.
    Then come the candidates that break the limits least.
    """
    skip = {recommendation.index, *(i for i, _ in recommendation.failed)}
    feasible = [i for i in design.choice.order if i not in skip][:_MOST_UNFLOWN]
    shown = [(i, _UNFLOWN) for i in feasible]
    shown += [(i, broken_by(design, i)) for i in design.choice.nearest]
    return shown


def broken_by(design: Design, index: int) -> str:
    """Return which limits a candidate breaks, and which are unknown."""
    slacks = dict(zip(design.choice.limits, design.choice.slack[index], strict=True))
    broken = " and ".join(k.quantity.label for k, s in slacks.items() if -math.inf < s < 0.0)
    unknown = " and ".join(k.quantity.label for k, s in slacks.items() if s == -math.inf)
    parts = [f"breaks {broken}" if broken else "", f"{unknown} unknown" if unknown else ""]
    return "; ".join(part for part in parts if part)
