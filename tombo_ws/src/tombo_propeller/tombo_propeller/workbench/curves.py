"""Everything of a propeller against rotor speed: all laws, what was measured, how sure it is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
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
    thrust_peak,
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
from tombo_propeller.design.readings import MeanReading, read
from tombo_propeller.workbench.propeller_choice import PAPER, ChosenPropeller

BENCH_RPM: Final = 2000.0
"""Speed of Table III."""
MEASURED_RPM: Final = (2000.0, 3200.0)
"""Speeds between which thrust was measured."""
_POINTS: Final = 121
_CONFIDENCE: Final = 0.9
_FORCE: Final = "collision_force_N"
_DEGREES: Final = 180.0 / math.pi


@dataclass(frozen=True, eq=False)
class SpeedCurve:
    """Values over the speeds, NaN where there is none, with the ends of their band."""

    name: str
    """The law, or "" where no law is behind it."""
    values: Array
    low: Array | None = None
    high: Array | None = None


@dataclass(frozen=True)
class ReferenceValue:
    """A printed or measured value."""

    rpm: float
    value: float
    deviation: float | None
    text: str
    chosen: bool
    """Whether it is of the propeller that is shown."""


@dataclass(frozen=True, eq=False)
class SpeedChart:
    """One figure against speed."""

    name: str
    title: str
    unit: str
    known: str
    """measured, modelled or extrapolated, and why."""
    curves: tuple[SpeedCurve, ...]
    readings: tuple[ReferenceValue, ...] = ()


@dataclass(frozen=True)
class SingleFigure:
    """A single number, and how it is known."""

    name: str
    value: float
    unit: str
    known: str
    beside: str


@dataclass(frozen=True, eq=False)
class PropellerCurves:
    """A propeller against speed."""

    label: str
    rpm: Array
    highest_rpm: float
    """The tip is at Mach 0.6."""
    panels: tuple[SpeedChart, ...]
    figures: tuple[SingleFigure, ...]
    refused: Mapping[str, str]
    """Law → why it can't be computed."""
    outer_radius_mm: float
    """Where the wing begins."""

    def mapping(self) -> dict[str, Any]:
        """Return it in the types of JSON, to five digits."""
        return dict(plain(_rounded(asdict(self))))


def propeller_curves(
    choice: ChosenPropeller, library: Library, top_rpm: float | None = None
) -> PropellerCurves:
    """Return every figure of a propeller over rotor speeds.

    Args:
        choice: the propeller.
        library: of the measurements.
        top_rpm: highest speed; None or more than that: Mach 0.6 at the tip.

    Raises:
        InputError: the speed is no number above 0.
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
    panels = (
        _thrust(choice, rpm, points, library),
        _modelled("torque_mNm", "Torque", "mN m", points, lambda p: 1e3 * p.torque_Nm,
                  "not validated: it may be 2 to 3 times too high"),
        _ratio(choice, points, library),
        _modelled("twist_deg", "Twist γ of the wing", "deg", points,
                  lambda p: _DEGREES * p.gamma_rad, _DEFORMED),
        _modelled("flap_deg", "Flap β", "deg", points, lambda p: _DEGREES * p.beta_rad, _DEFORMED),
        _modelled("lag_deg", "Lag α", "deg", points, lambda p: _DEGREES * p.alpha_rad, _DEFORMED),
        _force(choice, rpm, library),
    )  # fmt: skip
    return PropellerCurves(
        choice.words, rpm, top_speed(chosen) / RPM, panels, _figures(choice, points), refused,
        1e3 * chosen.blade.joint.outer_radius_m,
    )  # fmt: skip


_DEFORMED: Final = "never measured: the distance between the laws is the least that is unknown"


def top_speed(configuration: Configuration) -> float:
    """Return the speed [rad/s] at which the tip is as fast as the paper's at 18 000 rpm."""
    paper_tip_m = 0.1111
    return min(SPEED_LIMIT, SPEED_LIMIT * paper_tip_m / configuration.blade.tip_radius_m)


def force_share(choice: ChosenPropeller, library: Library, speed_rad_s: Any) -> Any:
    """Return how hard a blade strikes at a speed, over the paper's blade at 2000 rpm."""
    paper = library.blades[PAPER]
    share = 1.0 if choice.on_paper_blade else strike_share(choice.blade, paper)
    return share * speed_rad_s / (BENCH_RPM * RPM)


def bench_force(choice: ChosenPropeller, library: Library) -> tuple[float, float, float, str]:
    """Return value, low and high end [N] of the force at 2000 rpm, and how it is known.

    Of the paper's blade; `force_share` takes it to another blade or speed.
    """
    chosen = choice.configuration
    taken = chosen.measured.collision_force_N if chosen.measured else None
    if taken is None and chosen.nodus is None:
        taken = next(
            c.measured.collision_force_N
            for c in library.configurations.values()
            if c.nodus is None and c.measured is not None
        )
    reading = force_model(library)
    reach = reading.reach(_CONFIDENCE)
    if taken is not None:
        known = MEASURED_HERE if choice.on_paper_blade else EXTRAPOLATED
        return taken, max(taken - reach, 0.0), taken + reach, known
    known = MODELLED if choice.on_paper_blade else EXTRAPOLATED
    return reading.mean, max(reading.mean - reach, 0.0), reading.mean + reach, known


def force_model(library: Library) -> MeanReading:
    """Return what predicts the collision force of a nodus that was not measured."""
    return _force_model(measured_soft(library, library.blades[PAPER]))


@lru_cache(maxsize=4)
def _force_model(measured: tuple[Configuration, ...]) -> MeanReading:
    return read(_FORCE, measured)


@lru_cache(maxsize=16)
def _thrust_error(measured: tuple[Configuration, ...], law: str) -> float:
    return thrust_error(measured, law)


def _thrust(
    choice: ChosenPropeller, rpm: Array, points: Mapping[str, Operation], library: Library
) -> SpeedChart:
    soft = measured_soft(library, library.blades[PAPER])
    curves = []
    for law, operation in points.items():
        share = _thrust_error(soft, law)
        thrust = operation.thrust_N
        curves.append(SpeedCurve(law, thrust, (1.0 - share) * thrust, (1.0 + share) * thrust))
    shares = ", ".join(f"{law} {_thrust_error(soft, law):.1%}" for law in points)
    where = (
        f"extrapolated outside of {MEASURED_RPM[0]:g} to {MEASURED_RPM[1]:g} rpm"
        if choice.on_paper_blade
        else "extrapolated: nobody measured this blade with a nodus"
    )
    return SpeedChart(
        "thrust_N", "Thrust", "N", f"{where}; band: RMS error at 2000 rpm ({shares})",
        tuple(curves), _table_3(choice, library, "thrust_N", "thrust_dev_N", "measured"),
    )  # fmt: skip


def _ratio(
    choice: ChosenPropeller, points: Mapping[str, Operation], library: Library
) -> SpeedChart:
    panel = _modelled("lift_over_drag", "Lift over drag", "", points, lambda p: p.lift_over_drag,
                      "never measured: Table III's are the authors' simulation")  # fmt: skip
    readings = _table_3(
        choice, library, "printed_lift_over_drag", None, "simulated by the authors"
    )
    return SpeedChart(panel.name, panel.title, panel.unit, panel.known, panel.curves, readings)


def _modelled(
    name: str, title: str, unit: str, points: Mapping[str, Operation], of: Any, known: str
) -> SpeedChart:
    curves = tuple(SpeedCurve(law, of(operation)) for law, operation in points.items())
    return SpeedChart(name, title, unit, f"{MODELLED}, {known}", curves)


def _force(choice: ChosenPropeller, rpm: Array, library: Library) -> SpeedChart:
    value, low, high, known = bench_force(choice, library)
    share = force_share(choice, library, rpm * RPM)
    text = (
        f"{known} at 2000 rpm, extrapolated in proportion to speed; band: {_CONFIDENCE:.0%} to "
        "each side of a single reading"
    )
    readings = _table_3(choice, library, _FORCE, None, "measured")
    if choice.configuration.number == 13:
        readings += tuple(
            ReferenceValue(
                2500.0, at.force_N, None, f"Table II: struck {at.r_mm:g} mm from the hub", True
            )
            for at in library.collision_positions
        )
    return SpeedChart(
        _FORCE, "Collision force", "N", text,
        (SpeedCurve("", value * share, low * share, high * share),), readings,
    )  # fmt: skip


def _table_3(
    choice: ChosenPropeller, library: Library, name: str, deviation: str | None, how: str
) -> tuple[ReferenceValue, ...]:
    """Return Table III's values, those of the propeller itself marked; none of another blade."""
    if not choice.on_paper_blade:
        return ()
    readings = []
    for c in library.configurations.values():
        value = getattr(c.measured, name, None)
        if value is None or c.blade.name != PAPER:
            continue
        spread = None if deviation is None else getattr(c.measured, deviation)
        chosen = c.number == choice.configuration.number
        text = f"Table III, conf. {c.number}: {value:g}, {how}"
        readings.append(ReferenceValue(BENCH_RPM, value, spread, text, chosen))
    return tuple(readings)


def _figures(choice: ChosenPropeller, points: Mapping[str, Operation]) -> tuple[SingleFigure, ...]:
    """Return the single numbers that a nodus is judged by, law by law."""
    chosen = choice.configuration
    figures = []
    for law in points:
        limit = valid_speed(chosen, law) / RPM
        figures.append(
            SingleFigure(f"valid up to, {law}", limit, "rpm", MODELLED, "twist of the tip")
        )
        try:
            peak = thrust_peak(chosen, law)
        except InputError:
            continue
        thrust, speed = float(peak.thrust_N), float(peak.speed_rad_s) / RPM
        if bool(peak.has_maximum):
            figures.append(
                SingleFigure(
                    f"largest thrust, {law}", thrust, "N", EXTRAPOLATED, f"at {speed:.0f} rpm"
                )
            )
    return tuple(figures)


def _rounded(value: Any) -> Any:
    """Return arrays to five digits: what a page can show."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    if isinstance(value, np.ndarray):
        return [float(f"{x:.5g}") for x in value.tolist()]
    return value
