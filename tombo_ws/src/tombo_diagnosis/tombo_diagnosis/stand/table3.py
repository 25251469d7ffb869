"""The paper's Table III as a stand run: errors of the model, and what to measure to decide.

Each configuration is predicted by the others under each physical extension; the measurements that
would decide are those in which the fitted candidates differ most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.engine.verdict import LOG_BF_DISTINCT
from tombo_diagnosis.stand.tables.assemble import StandData, stiffness
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.wording import display_name
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import (
    RPM,
    SPEED_LIMIT,
    configuration,
    configurations,
    evaluate,
    parameter_row,
    valid_speed,
)
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS, Param, Setup, predict

MEAN = "mean of the others"
PHYSICAL = (
    *("centrifugal_stiffening", "torsion_constant", "load_sharing", "in_plane_term"),
    *("thrust_coefficient", "inflow", "air_density", "rpm_scale", "thrust_tare", "thrust_gain"),
)
"""What may be tried on thrust at one speed."""


@dataclass(frozen=True)
class LeftOutPrediction:
    """How well something predicts the thrust of a configuration left out."""

    what: str
    rmse: float
    """Over the soft configurations, each predicted by the others [N]."""
    low: float
    """End of the 95 % interval of the difference of the squared errors to those of the mean, as a
    root with its sign [N]: above 0 is worse than the mean."""
    high: float
    parameter: str
    """Fitted to all, with unit; empty: none."""


def predictions(
    points: OperatingPoints, soft: NDArray[np.bool_], law: str
) -> tuple[LeftOutPrediction, ...]:
    """Leave one soft configuration out after the other; least squares, each counts alike."""
    y = points.readings[:, 0]
    places = np.flatnonzero(soft)
    means = np.array([y[[k for k in places if k != out]].mean() for out in places]) - y[places]
    compared = [_compared(MEAN, means, means, "")]
    bare = predict(points.setup, {})[places, 0] - y[places]
    compared.append(_compared(f"law {law} as it is", bare, means, ""))
    for effect in PHYSICAL:
        parameter = STAND_EFFECTS[effect].theta[0]
        values, errors = errors_by_value(points, soft, effect)
        left = []
        for k in range(places.size):
            left.append(float(errors[_least_squares(np.delete(errors, k, axis=1)), k]))
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        shown = f"{parameter.name} = {values[_least_squares(errors)]:.3g}{unit}"
        compared.append(_compared(effect, np.array(left), means, shown))
    return tuple(sorted(compared, key=lambda e: e.rmse))


def errors_by_value(
    points: OperatingPoints, soft: NDArray[np.bool_], effect: str
) -> tuple[Array, Array]:
    """Return values (V,) of an effect's first parameter, and errors of thrust (V, soft) [N]."""
    values = values_of(STAND_EFFECTS[effect].theta[0])
    table = np.stack([predict(points.setup, {effect: (v,)})[soft, 0] for v in values])
    return values, np.where(np.isfinite(table), table - points.readings[soft, 0], np.inf)


def least_squares_fit(points: OperatingPoints, soft: NDArray[np.bool_], effect: str) -> float:
    """Return an effect's parameter that fits the soft configurations' thrust best."""
    values, errors = errors_by_value(points, soft, effect)
    return float(values[_least_squares(errors)])


def _least_squares(errors: Array) -> int:
    return int(np.argmin((errors**2).sum(axis=1)))


def _compared(what: str, errors: Array, means: Array, parameter: str) -> LeftOutPrediction:
    """Return the error left out, and how its square differs from the mean's (t interval)."""
    gap = errors**2 - means**2
    low = high = 0.0
    if np.ptp(gap) > 0.0:
        half = 2.306 * float(gap.std(ddof=1)) / math.sqrt(gap.size)  # t, 8 degrees of freedom
        ends = (float(gap.mean()) + s * half for s in (-1.0, 1.0))
        low, high = (math.copysign(math.sqrt(abs(end)), end) for end in ends)
    return LeftOutPrediction(what, float(np.sqrt(np.mean(errors**2))), low, high, parameter)


def values_of(p: Param) -> Array:
    """Return values of a parameter within its bounds, its null among them, dense near it."""
    span = abs(p.typical - p.null)
    steps = span * np.sinh(np.linspace(-6.0, 6.0, 1201)) / 10.0
    return np.asarray(np.unique(np.clip(p.null + steps, *p.bounds)))


AS_IT_IS = "the law as it is"
_SEPARABLE = ("centrifugal_stiffening", "torsion_constant", "load_sharing", "in_plane_term",
         "thrust_coefficient")  # fmt: skip
"""Those that change how thrust depends on the nodus, and the plainest that does not."""


@dataclass(frozen=True)
class DiscriminatingMeasurement:
    """A measurement, and how precise it must be to tell stiffening from all other candidates."""

    what: str
    rival: str
    """The candidate that comes closest."""
    difference: float
    """Between what the two predict [unit]."""
    sigma: float
    """Largest standard deviation that still gives a log Bayes factor of 4 [unit]."""
    unit: str
    expected: float
    """What stiffening predicts [unit]."""


def least_squares_fits(points: OperatingPoints) -> dict[str, float]:
    """Return candidate -> parameter that fits the soft configurations' thrust best."""
    soft = np.isfinite(points.stiffness)
    return {effect: least_squares_fit(points, soft, effect) for effect in _SEPARABLE}


def predicted_readings(
    fits: dict[str, float], conf: int, rpm: Array, law: str
) -> dict[str, Array]:
    """Return candidate, or AS_IT_IS -> readings (N, 4) of a configuration; NaN: no root."""
    n = rpm.size
    row = np.tile(parameter_row(configuration(conf), law), (n, 1))
    zero = np.zeros(n, np.int64)
    setup = Setup(rpm * RPM, row, zero, zero, np.zeros(n), law)
    readings = {effect: predict(setup, {effect: (value,)}) for effect, value in fits.items()}
    return {AS_IT_IS: predict(setup, {})} | readings


def settling(fits: dict[str, float], law: str) -> tuple[DiscriminatingMeasurement, ...]:
    """Simulate the candidates where they differ, and ask how well to look; easiest first.

    With one reading of noise sigma, the log Bayes factor between two candidates as fitted is
    their difference squared over 2 sigma^2 on average; sigma is what makes it 4.
    """
    measurements = []
    for conf, channel, rpm, unit in _experiments(law):
        c = CHANNELS.index(channel)
        scale = math.degrees(1.0) if unit == "deg" else 1.0
        every = predicted_readings(fits, conf, np.array([rpm]), law)
        shown = {name: scale * float(values[0, c]) for name, values in every.items()}
        true = shown.pop("centrifugal_stiffening")
        gaps = {name: abs(true - other) for name, other in shown.items() if math.isfinite(other)}
        rival = min(gaps, key=lambda name: gaps[name])
        measurements.append(
            DiscriminatingMeasurement(
                f"{channel} of Conf. {conf} at {rpm:.0f} rpm", rival, gaps[rival],
                gaps[rival] / math.sqrt(2.0 * LOG_BF_DISTINCT), unit, true,
            )
        )  # fmt: skip
    return tuple(sorted(measurements, key=lambda s: -s.sigma / max(abs(s.expected), 1e-9)))


def _experiments(law: str) -> list[tuple[int, str, float, str]]:
    return [
        (conf, channel, rpm, unit)
        for conf in (5, 13)
        for rpm in (3200.0, 4500.0, 6000.0)
        if rpm < min(valid_speed(configuration(conf), law), SPEED_LIMIT) / RPM
        for channel, unit in (("thrust", "N"), ("torque", "N m"), ("beta", "deg"))
    ]


SPEED = 2000.0 * RPM
"""rad/s of the table."""
_THEIRS = "their mean"
TWO_VALUES = (
    "“Fitted to all” is by least squares alone, each configuration alike; a cause’s value weighs "
    "by the printed deviations and keeps near the size expected beforehand, which beside such "
    "deviations decides: so the two differ."
)
"""Why a parameter has one value among the causes and another here."""


@dataclass(frozen=True)
class Table3:
    """Results on Table III."""

    confs: tuple[int, ...]
    measured: tuple[float, ...]
    deviations: tuple[float, ...]
    laws: dict[str, tuple[float, ...]]
    """Law -> thrust [N] of each configuration."""
    rms: dict[str, float]
    """RMS error of each law, and of the mean itself, over the soft ones [N]."""
    chi2: dict[str, float]
    """Sum of squares over the printed deviations, over the soft ones: their count is expected."""
    spearman: float
    """Rank correlation of measured thrust with the shear modulus."""
    spearman_p: float
    predictions: tuple[LeftOutPrediction, ...]
    """Leaving one configuration out, best first."""
    settling: tuple[DiscriminatingMeasurement, ...]
    """Measurements that would settle it, easiest first."""
    fits: dict[str, float]
    """Candidate -> its parameter fitted to the table."""
    stiffness: tuple[float, ...]
    """Shear modulus of each configuration's nodus [MPa]; NaN: rigid."""
    law: str
    """The nominal one."""


def table3_points(law: str = "repaired") -> OperatingPoints:
    """Return Table III as operating points; the noise is the printed deviation."""
    measured = [c for c in configurations() if c.measured is not None]
    n = len(measured)
    readings = np.full((n, len(CHANNELS)), np.nan)
    sigma = np.ones((n, len(CHANNELS)))
    for k, c in enumerate(measured):
        assert c.measured is not None
        readings[k, 0], sigma[k, 0] = c.measured.thrust_N, c.measured.thrust_dev_N
    setup = Setup(
        speed=np.full(n, SPEED),
        rows=np.stack([parameter_row(c, law) for c in measured]),
        propeller=np.arange(n),
        run=np.arange(n),
        elapsed=np.zeros(n),
        law=law,
        largest_thrust=float(readings[:, 0].max()),
    )
    names = tuple(f"Conf. {c.number}" for c in measured)
    stiff = np.array([stiffness(c) for c in measured])
    return OperatingPoints(setup, readings, sigma, ("Table III",) * n, names, stiff)


def table3_assembled(law: str = "repaired") -> StandData:
    """Return Table III as what `diagnose_points` takes."""
    return StandData(table3_points(law), (), ())


def study_table3(law: str = "repaired") -> Table3:
    """Return what Table III says about a law and its possible extensions."""
    from scipy import stats

    points = table3_points(law)
    measured = [c for c in configurations() if c.measured is not None]
    soft = np.array([not c.rigid for c in measured])
    y, dev = points.readings[:, 0], points.sigma[:, 0]
    laws = {
        name: tuple(float(evaluate(c, SPEED, name).thrust_N) for c in measured)
        for name in ("published", "repaired", "consistent")
    }
    mean = float(y[soft].mean())
    predicted = {**{k: np.array(v)[soft] for k, v in laws.items()}, _THEIRS: mean}
    rms = {k: float(np.sqrt(np.mean((y[soft] - v) ** 2))) for k, v in predicted.items()}
    chi2 = {k: float(np.sum(((y[soft] - v) / dev[soft]) ** 2)) for k, v in predicted.items()}
    fits = least_squares_fits(points)
    rank = stats.spearmanr(points.stiffness[soft], y[soft])
    return Table3(
        tuple(c.number for c in measured), tuple(map(float, y)), tuple(map(float, dev)), laws, rms,
        chi2, float(rank.statistic), float(rank.pvalue), predictions(points, soft, law),
        settling(fits, law), fits, tuple(map(float, points.stiffness)), law,
    )  # fmt: skip


def statement(study: Table3) -> str:
    """Return what Table III says, in words."""
    mean = next(p for p in study.predictions if p.what == MEAN)
    best = next(p for p in study.predictions if p.what in PHYSICAL)
    surely = [p.what for p in study.predictions if p.high < 0.0]
    law, name = study.law, display_name(best.what)
    columns = zip(study.confs, study.laws[law], study.measured, strict=True)
    gaps = {c: thrust / measured - 1.0 for c, thrust, measured in columns if c != 0}
    worst = sorted(gaps, key=lambda c: gaps[c])[:2]
    wrong = " and ".join(f"{100.0 * gaps[c]:+.0f} % for Conf. {c}" for c in worst)
    result = (
        f"{', '.join(surely)} predicts better than the mean"
        if surely
        else f"no extension predicts the thrust of a configuration left out surely better than "
        f"the mean of the others ({mean.rmse:.4f} N): the best, {name}, has {best.rmse:.4f} N, "
        f"{best.low:+.3f} to {best.high:+.3f} N against it"
    )
    thrust = [s for s in study.settling if s.what.startswith("thrust")]
    first, second = (next(s for s in thrust if rpm in s.what) for rpm in ("3200", "4500"))
    return (
        f"The model lets thrust fall with softness ({wrong}); measured thrust does not (rank "
        f"correlation with stiffness {study.spearman:.2f}, p = {study.spearman_p:.2f}). Of the "
        f"soft ones the law has an RMS error of {study.rms[law]:.3f} N, their mean "
        f"{study.rms[_THEIRS]:.3f} N; {result}. With deviations of {min(study.deviations):.2f} to "
        f"{max(study.deviations):.2f} N nothing more is certified. It would be settled by "
        f"{first.what} within {first.sigma:.2g} N, or {second.what} within {second.sigma:.2g} N."
    )
