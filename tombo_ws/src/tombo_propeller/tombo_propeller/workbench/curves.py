"""A propeller against rotor speed: all laws, measured values, and their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import check_number
from tombo_dynamics.propeller import (
    LAWS,
    RPM,
    SPEED_LIMIT,
    Configuration,
    Library,
    Operation,
    evaluate,
    speed_of_maximum_thrust,
    valid_speed,
)
from tombo_flight.json_text import plain
from tombo_propeller.design.candidates import measured_soft
from tombo_propeller.design.design import (
    EXTRAPOLATED,
    MEASURED_HERE,
    MODELLED,
    strike_share,
    thrust_error,
)
from tombo_propeller.design.readings import read
from tombo_propeller.workbench.propeller_choice import PAPER, ChosenPropeller

BENCH_RPM: Final = 2000.0
"""Speed of Table III."""
MEASURED_RPM: Final = (2000.0, 3200.0)
"""Speeds between which thrust was measured."""
_POINTS: Final = 121
_CONFIDENCE: Final = 0.9
_FORCE: Final = "collision_force_N"
_DEGREES: Final = 180.0 / math.pi


def propeller_curves(
    choice: ChosenPropeller, library: Library, top_rpm: float | None = None
) -> dict[str, Any]:
    """Return every figure of a propeller over rotor speeds, in the types of JSON.

    Args:
        choice: the propeller.
        library: of the measurements.
        top_rpm: highest speed; None or more than that: Mach 0.6 at the tip.

    Returns:
        `rpm`, and `panels`: each a figure with its unit, its source (`known`), its `curves` over
        the speeds and `readings`, printed or measured values. A curve has five digits, None for
        a missing value, and `low` and `high` as its band. `figures`: single numbers. `refused`:
        law -> why it can't be computed. `highest_rpm`: the tip is at Mach 0.6.

    Raises:
        InputError: the speed is not a number above 0.
    """
    chosen = choice.configuration
    highest = top_speed(chosen) / RPM
    if top_rpm is not None:
        highest = min(highest, check_number("top_rpm", top_rpm, "rpm", (1.0, 1e5)))
    rpm = highest * np.arange(_POINTS, dtype=np.float64) / (_POINTS - 1)
    points: dict[str, Operation] = {}
    refused: dict[str, str] = {}
    for law in LAWS:
        try:
            points[law] = evaluate(chosen, rpm * RPM, law, outside="mask")
        except InputError as error:
            refused[law] = str(error)
    panels = [
        _thrust(choice, points, library),
        _modelled("torque_mNm", "Torque", "mN m", points, lambda p: 1e3 * p.torque_Nm,
                  "not validated: it may be 2 to 3 times too high"),
        _modelled("lift_over_drag", "Lift over drag", "", points, lambda p: p.lift_over_drag,
                  "never measured: Table III's are the authors' simulation")
        | {"readings": _table_3(
            choice, library, "printed_lift_over_drag", None, "simulated by the authors")},
        _modelled("twist_deg", "Twist γ of the wing", "deg", points,
                  lambda p: _DEGREES * p.gamma_rad, _DEFORMED),
        _modelled("flap_deg", "Flap β", "deg", points, lambda p: _DEGREES * p.beta_rad, _DEFORMED),
        _modelled("lag_deg", "Lag α", "deg", points, lambda p: _DEGREES * p.alpha_rad, _DEFORMED),
        _force(choice, rpm, library),
    ]  # fmt: skip
    return {
        "label": choice.label,
        "rpm": _shown(rpm),
        "highest_rpm": top_speed(chosen) / RPM,
        "panels": plain(panels),
        "figures": plain(_figures(choice, points)),
        "refused": refused,
        "outer_radius_mm": 1e3 * chosen.blade.joint.outer_radius_m,
    }


def _panel(
    name: str,
    title: str,
    unit: str,
    known: str,
    curves: list[dict[str, Any]],
    readings: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Return one figure against speed, with how it is known and why."""
    return {
        "name": name,
        "title": title,
        "unit": unit,
        "known": known,
        "curves": curves,
        "readings": readings,
    }


def _curve(
    law: str, values: Array, low: Array | None = None, high: Array | None = None
) -> dict[str, Any]:
    """Return values over the speeds with the ends of their band; `law` "" if none is behind it."""
    return {"name": law, "values": _shown(values), "low": _shown(low), "high": _shown(high)}


def _shown(values: Array | None) -> list[float] | None:
    """Return values to five digits: contents of a page."""
    return None if values is None else [float(f"{x:.5g}") for x in values.tolist()]


def _reading(
    rpm: float, value: float, deviation: float | None, text: str, chosen: bool
) -> dict[str, Any]:
    """Return a printed or measured value; `chosen` if it is of the propeller that is shown."""
    return {"rpm": rpm, "value": value, "deviation": deviation, "text": text, "chosen": chosen}


_DEFORMED: Final = "never measured: the difference between the laws is a lower error bound"


def top_speed(configuration: Configuration) -> float:
    """Return the speed [rad/s] at which the tip is as fast as the paper's at 18 000 rpm."""
    paper_tip_m = 0.1111
    return min(SPEED_LIMIT, SPEED_LIMIT * paper_tip_m / configuration.blade.tip_radius_m)


def bench_force(choice: ChosenPropeller, library: Library) -> tuple[float, float, float, str]:
    """Return value, low and high end [N] of the force at 2000 rpm, and how it is known.

    Of the paper's blade; `_force` takes it to another blade or speed.
    """
    chosen = choice.configuration
    taken = chosen.measured.collision_force_N if chosen.measured else None
    if taken is None and chosen.nodus is None:
        taken = next(
            c.measured.collision_force_N
            for c in library.configurations.values()
            if c.nodus is None and c.measured is not None
        )
    reading = read(_FORCE, measured_soft(library, library.blades[PAPER]))
    reach = reading.reach(_CONFIDENCE)
    if taken is not None:
        known = MEASURED_HERE if choice.on_paper_blade else EXTRAPOLATED
        return taken, max(taken - reach, 0.0), taken + reach, known
    known = MODELLED if choice.on_paper_blade else EXTRAPOLATED
    return reading.mean, max(reading.mean - reach, 0.0), reading.mean + reach, known


def _thrust(
    choice: ChosenPropeller, points: Mapping[str, Operation], library: Library
) -> dict[str, Any]:
    soft = measured_soft(library, library.blades[PAPER])
    errors = {law: thrust_error(soft, law) for law in points}
    curves = [
        _curve(law, p.thrust_N, (1.0 - errors[law]) * p.thrust_N, (1.0 + errors[law]) * p.thrust_N)
        for law, p in points.items()
    ]
    shares = ", ".join(f"{law} {error:.1%}" for law, error in errors.items())
    where = (
        f"extrapolated outside of {MEASURED_RPM[0]:g} to {MEASURED_RPM[1]:g} rpm"
        if choice.on_paper_blade
        else "extrapolated: nobody measured this blade with a nodus"
    )
    known = f"{where}; band: RMS error at 2000 rpm ({shares})"
    readings = _table_3(choice, library, "thrust_N", "thrust_dev_N", "measured")
    return _panel("thrust_N", "Thrust", "N", known, curves, readings)


def _modelled(
    name: str, title: str, unit: str, points: Mapping[str, Operation], of: Any, known: str
) -> dict[str, Any]:
    curves = [_curve(law, of(operation)) for law, operation in points.items()]
    return _panel(name, title, unit, f"{MODELLED}, {known}", curves)


def _force(choice: ChosenPropeller, rpm: Array, library: Library) -> dict[str, Any]:
    value, low, high, known = bench_force(choice, library)
    blade = 1.0 if choice.on_paper_blade else strike_share(choice.blade, library.blades[PAPER])
    share = blade * (rpm * RPM) / (BENCH_RPM * RPM)
    text = (
        f"{known} at 2000 rpm, extrapolated in proportion to speed; band: {_CONFIDENCE:.0%} to "
        "each side of a single reading"
    )
    readings = _table_3(choice, library, _FORCE, None, "measured")
    if choice.configuration.number == 13:
        readings += [
            _reading(
                2500.0, at.force_N, None, f"Table II: struck {at.r_mm:g} mm from the hub", True
            )
            for at in library.collision_positions
        ]
    curve = _curve("", value * share, low * share, high * share)
    return _panel(_FORCE, "Collision force", "N", text, [curve], readings)


def _table_3(
    choice: ChosenPropeller, library: Library, name: str, deviation: str | None, how: str
) -> list[dict[str, Any]]:
    """Return Table III's values, those of the propeller itself marked; none of another blade."""
    readings = []
    for c in library.configurations.values() if choice.on_paper_blade else ():
        value = getattr(c.measured, name, None)
        if value is None or c.blade.name != PAPER:
            continue
        spread = None if deviation is None else getattr(c.measured, deviation)
        chosen = c.number == choice.configuration.number
        text = f"Table III, conf. {c.number}: {value:g}, {how}"
        readings.append(_reading(BENCH_RPM, value, spread, text, chosen))
    return readings


def _figures(choice: ChosenPropeller, points: Mapping[str, Operation]) -> list[dict[str, Any]]:
    """Return the single numbers that a nodus is judged by, law by law."""
    rows: list[tuple[str, float, str, str, str]] = []
    for law in points:
        limit = valid_speed(choice.configuration, law) / RPM
        rows.append((f"valid up to, {law}", limit, "rpm", MODELLED, "twist of the tip"))
        try:
            top, has_maximum = speed_of_maximum_thrust(choice.configuration, law)
        except InputError:
            continue
        if has_maximum:
            thrust = float(evaluate(choice.configuration, top, law, outside="keep").thrust_N)
            largest = f"largest thrust, {law}"
            rows.append((largest, thrust, "N", EXTRAPOLATED, f"at {top / RPM:.0f} rpm"))
    return [
        dict(zip(("name", "value", "unit", "known", "beside"), row, strict=True)) for row in rows
    ]
