"""A design in sentences: reasons, binding limit, sources of predictions, what is not known."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from tombo_dynamics.propeller import RPM, Configuration
from tombo_propeller.design.candidate_evaluation import slack
from tombo_propeller.design.candidates import describe
from tombo_propeller.design.design import Design
from tombo_propeller.design.operating_points import flight_performance
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import MEASURED, NAMES, QUANTITIES, Limit, Quantity
from tombo_propeller.design.response_regression import MEAN, ResponseModel
from tombo_propeller.design.table_cells import EVIDENCE, broken_by, figure, name_of

_BENCH_RPM = 2000.0


def headline(found: Design, made: Recommendation) -> str:
    """Return the outcome in a line."""
    if made.index is not None:
        name, nodus = name_of(found, made.index), found.judged.configurations[made.index]
        whole = describe(nodus)
        return whole if name == whole else f"{name}: {whole}"
    if found.feasible:
        return "Some candidates keep to all limits, but none of those flown recovers as claimed"
    return "No candidate keeps to all limits"


def reasons(found: Design, made: Recommendation) -> list[str]:
    """Return why this one: evidence, what binds, who else was tried."""
    judged, choice = found.judged, found.choice
    counts = [int((choice.feasible & (judged.tier == k)).sum()) for k in range(3)]
    split = ", ".join(f"{n} {words}" for n, words in zip(counts, EVIDENCE, strict=True))
    lines = [
        f"{int(choice.feasible.sum())} of {len(judged.configurations)} candidates keep to all "
        f"limits ({split})."
    ]
    for index, check in made.failed:
        reasons = [
            f"{c.text} {c.simulated:.3g} of {c.claimed:.3g}"
            for c in (*check.claims, *check.limits)
            if not c.held
        ]
        broken = "; ".join(reasons[:2])
        more = ""
        if check.falls_m is not None and check.falls_m > 1.0:
            more = f", falls up to {check.falls_m:.1f} m"
        lines.append(f"Passed over: {name_of(found, index)}, fails in flight ({broken}{more}).")
    if made.failed:
        lines.append(
            "In this flight too little thrust, too weak a push or too slow a blade lets a vehicle "
            "fall."
        )
    if made.unflown and made.index is None:
        lines.append(
            f"{made.unflown} more keep to the limits and were not flown: like those, or after too "
            "many failures."
        )
    if made.instead is not None:
        lines.append(
            f"Nearest that flies: {name_of(found, made.instead)}, it "
            f"{broken_by(found, made.instead)}."
        )
    if made.index is None:
        return lines
    lines.append(f"It is {EVIDENCE[int(judged.tier[made.index])]}; measured ones go first.")
    k = int(choice.slack[made.index].argmin())
    limit = choice.limits[k]
    value = judged.counted[made.index, NAMES.index(limit.quantity.name)]
    spare = choice.slack[made.index, k]
    lines.append(
        f"What binds: {limit.text}; it has {figure(value, limit.quantity)}, {spare:.0%} to spare."
    )
    if judged.operating.motor_limits[made.index]:
        lines.append("The motor limits its thrust, not the nodus: a stiffer one gains little.")
    else:
        usable = judged.operating.usable_speed[made.index] / RPM
        lines.append(
            f"The nodus limits its thrust: 0.9 of the speed of maximum thrust is {usable:.0f} rpm."
        )
    return lines


def relief_lines(found: Design) -> list[str]:
    """Return which limit must give, and by how much, where nothing keeps to all of them."""
    if found.feasible:
        return []
    lines = []
    for limit, value in zip(found.choice.limits, found.choice.relief, strict=True):
        if value is None:
            if len(found.choice.limits) > 1:
                lines.append(f"{limit.text}: giving up this one alone does not help.")
            continue
        unit = f" {limit.quantity.unit}" if limit.quantity.unit else ""
        if limit.quantity.name == NAMES[0] and value < 1.0:
            kept = " that keeps to the other limits" if len(found.choice.limits) > 1 else ""
            lines.append(
                f"{limit.text}: the most of any candidate{kept} is {_reached(value, limit)}; "
                "below 1 it can't take off."
            )
            continue
        off = abs(value - limit.value)
        side = "lower" if limit.quantity.more_is_better else "higher"
        lines.append(
            f"{limit.text}: must be {off:.3g}{unit} {side}, {_reached(value, limit)}{unit}, if "
            "the others stay."
        )
    if not any(value is not None for value in found.choice.relief):
        lines.append("More than one limit has to give; see the nearest candidates.")
    if not found.request.extrapolate and _predictions_would_do(found):
        lines.append(
            "Collision force, recovery time and noise outside of what was tested count as "
            "unknown; --extrapolate lets their predictions count."
        )
    return lines


def _predictions_would_do(found: Design) -> bool:
    """Return whether anything keeps to all limits once every prediction counts."""
    judged = found.judged
    counted = np.where(np.isnan(judged.counted), judged.high, judged.counted)
    return bool((slack(counted, found.choice.limits).min(axis=1) >= 0.0).any())


def sources(found: Design) -> list[str]:
    """Return how each measured figure is predicted where it was not measured."""
    return [_source(found.readings[q.name], q) for q in QUANTITIES if q.name in MEASURED]


def _source(reading: ResponseModel, quantity: Quantity) -> str:
    unit = quantity.unit
    if not reading.trials:
        return f"{quantity.words}: {reading.count} readings, too few to predict any."
    best = reading.trials[0]
    rank = f"rank correlation with stiffness {reading.rank_correlation:.2f}"
    rank += f" (p = {reading.rank_p_value:.2f})"
    if reading.regressor == MEAN:
        verdict = (
            f"no regressor predicts it: best {best.regressor} with {best.error:.3g} {unit} on "
            f"readings left out, the mean {reading.mean_error:.3g} {unit}; chance does as well "
            f"with p = {reading.chance:.2f}. Used: the mean, {reading.mean:.3g} {unit}"
        )
    else:
        verdict = (
            f"predicted from {best.regressor}: {best.error:.3g} {unit} on readings left out, "
            f"the mean {reading.mean_error:.3g} {unit} (chance: p = {reading.chance:.3f})"
        )
    return f"{quantity.words}: {reading.count} readings; {rank}; {verdict}."


def chance_of(found: Design, limit: Limit) -> float:
    """Return how likely any new soft propeller keeps to a limit, from all readings; NaN: unknown.

    That is what a measured one is worth if the scatter between propellers is that of readings.
    """
    name = limit.quantity.name
    if name not in MEASURED or found.readings[name].count < 4:
        return math.nan
    reading = found.readings[name]
    away = (limit.value - reading.mean) / reading.mean_error
    return float(stats.t.cdf(away, reading.count - 1))


def caveats(found: Design, made: Recommendation) -> list[str]:
    """Return what is extrapolated or not known, most important first."""
    lines = []
    index = made.index
    if index is not None:
        lines += _of_the_recommended(found, index)
        if made.upper is not None:
            flown = made.upper.claims[1]
            lines.append(
                f"With {made.upper.force_N:.0f} N and {made.upper.recovery_s:.2f} s, the upper "
                f"ends of what all readings predict, {flown.simulated:.0f} of {flown.claimed:.0f} "
                "flights recover."
            )
    lines.append(
        f"The model's thrust is off by {found.thrust_error:.1%} (RMS) at 2000 rpm, where it was "
        "measured; measured thrust does not follow stiffness."
    )
    lines.append(
        "Collision force is Table III's, one reading each at 2000 rpm. Where the blade is struck "
        "matters as much as which nodus it is: Table II has 136 to 337 N along one blade, at 2500 "
        "rpm."
    )
    lines.append("Noise is at 2000 rpm and 5 m; nobody measured it at the speed of hover.")
    return lines


def _of_the_recommended(found: Design, index: int) -> list[str]:
    judged = found.judged
    configuration = judged.configurations[index]
    hover = judged.operating.hover_speed[index] / RPM
    top = judged.operating.usable_speed[index] / RPM
    lines = []
    if judged.outside[index]:
        lines.append(f"Outside of what was tested: {'; '.join(judged.outside[index])}.")
    others = [
        f"{law} {_thrust_margin(found, configuration, law):.2f}"
        for law in ("repaired", "consistent", "published")
        if law != found.request.law and (law != "published" or configuration.blade.published)
    ]
    lines.append(
        f"Hover at {hover:.0f} rpm and the thrust margin at {top:.0f} rpm are the model's: nobody "
        f"measured beyond 3200 rpm. Thrust margin under other laws: {', '.join(others)}."
    )
    force = float(judged.value[index, NAMES.index("collision_force_N")])
    if math.isfinite(force):
        lines.append(
            f"If the force grows in proportion to speed, {force:.0f} N at 2000 rpm are "
            f"{force * hover / _BENCH_RPM:.0f} N in hover. Nobody measured how it grows."
        )
    for limit in found.choice.limits:
        label = judged.labels[index][NAMES.index(limit.quantity.name)]
        chance = chance_of(found, limit)
        if label == "measured" and math.isfinite(chance):
            lines.append(
                f"{limit.text}: kept by its one reading. If readings scatter as much as "
                f"configurations do, the next one keeps it with {chance:.0%}."
            )
    return lines


def _thrust_margin(found: Design, configuration: Configuration, law: str) -> float:
    usable = flight_performance([configuration], found.vehicle, law).usable_thrust[0]
    return float(usable / found.vehicle.hover_thrust())


def _reached(value: float, limit: Limit) -> str:
    """Return a value rounded to the side that the limit still lets through."""
    digits = 1 if limit.quantity.unit in ("N", "dB") else 3
    scale = 10**digits
    whole = (
        math.floor(value * scale) if limit.quantity.more_is_better else math.ceil(value * scale)
    )
    return f"{whole / scale:g}"
