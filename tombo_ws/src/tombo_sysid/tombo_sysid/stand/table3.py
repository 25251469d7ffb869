"""The paper's Table III as a stand run: what the model gets wrong, and what would settle it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.propeller import (
    SPEED_LIMIT,
    configuration,
    configurations,
    evaluate,
    nodus_moduli,
    parameter_row,
    valid_speed,
)
from tombo_dynamics.propeller.effects import (
    CHANNELS,
    STAND_EFFECTS,
    Setup,
    StandParam,
    predict,
)
from tombo_sysid.stand.assemble import Assembled
from tombo_sysid.stand.points import Points
from tombo_sysid.verdict import TELLS

Array = NDArray[np.float64]

SPEED = 2000.0 * math.pi / 30.0
"""rad/s of the table."""
_RPM = 30.0 / math.pi
_MEAN, _THEIRS = "mean of the others", "their mean"
PHYSICAL = (
    *("centrifugal_stiffening", "torsion_constant", "load_sharing", "in_plane_term"),
    *("thrust_coefficient", "inflow", "air_density", "rpm_scale", "thrust_tare", "thrust_gain"),
)
"""What may be tried on thrust at one speed."""
_SHAPING = ("centrifugal_stiffening", "torsion_constant", "load_sharing", "in_plane_term")
"""Those that change how thrust depends on the nodus."""


@dataclass(frozen=True)
class Prediction:
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


@dataclass(frozen=True)
class Settling:
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


@dataclass(frozen=True)
class Table3:
    """What Table III says about the model."""

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
    predictions: tuple[Prediction, ...]
    """Leaving one configuration out, best first."""
    settling: tuple[Settling, ...]
    """Measurements that would settle it, easiest first."""


def table3_points(law: str = "repaired") -> Points:
    """Return Table III as operating points; the noise is the printed deviation."""
    own = [c for c in configurations() if c.measured is not None]
    n = len(own)
    readings = np.full((n, len(CHANNELS)), np.nan)
    sigma = np.ones((n, len(CHANNELS)))
    for k, c in enumerate(own):
        assert c.measured is not None
        readings[k, 0], sigma[k, 0] = c.measured.thrust_N, c.measured.thrust_dev_N
    setup = Setup(
        speed=np.full(n, SPEED),
        rows=np.stack([parameter_row(c, law) for c in own]),
        propeller=np.arange(n),
        run=np.arange(n),
        elapsed=np.zeros(n),
        law=law,
        largest_thrust=float(readings[:, 0].max()),
    )
    names = tuple(f"Conf. {c.number}" for c in own)
    stiff = np.array([math.nan if c.rigid else nodus_moduli(c).G_N_MPa for c in own])
    return Points(setup, readings, sigma, ("Table III",) * n, names, stiff)


def table3_assembled(law: str = "repaired") -> Assembled:
    """Return Table III as what `diagnose_points` takes."""
    return Assembled(table3_points(law), (), ())


def study_table3(law: str = "repaired") -> Table3:
    """Return what Table III says about a law and its possible extensions."""
    from scipy import stats

    points = table3_points(law)
    own = [c for c in configurations() if c.measured is not None]
    soft = np.array([not c.rigid for c in own])
    y, dev = points.readings[:, 0], points.sigma[:, 0]
    laws = {
        name: tuple(float(evaluate(c, SPEED, name).thrust_N) for c in own)
        for name in ("published", "repaired", "consistent")
    }
    mean = float(y[soft].mean())
    predicted = {**{k: np.array(v)[soft] for k, v in laws.items()}, _THEIRS: mean}
    rms = {k: float(np.sqrt(np.mean((y[soft] - v) ** 2))) for k, v in predicted.items()}
    chi2 = {k: float(np.sum(((y[soft] - v) / dev[soft]) ** 2)) for k, v in predicted.items()}
    rank = stats.spearmanr(points.stiffness[soft], y[soft])
    return Table3(
        tuple(c.number for c in own), tuple(map(float, y)), tuple(map(float, dev)), laws, rms,
        chi2,
        float(rank.statistic), float(rank.pvalue), _predictions(points, soft, law),
        _settling(law),
    )  # fmt: skip


def statement(study: Table3) -> str:
    """Return what Table III says, in words."""
    mean = next(p for p in study.predictions if p.what == _MEAN)
    best = next(p for p in study.predictions if p.what in PHYSICAL)
    surely = [p.what for p in study.predictions if p.high < 0.0]
    k = [c for c in study.confs if c != 0]
    law = "repaired"
    gaps = {
        c: study.laws[law][i] / study.measured[i] - 1.0
        for i, c in enumerate(study.confs)
        if c in k
    }
    worst = sorted(k, key=lambda c: gaps[c])[:2]
    wrong = " and ".join(f"{100.0 * gaps[c]:+.0f} % for Conf. {c}" for c in worst)
    name = best.what.replace("_", " ")
    told = (
        f"{', '.join(surely)} predicts better than the mean"
        if surely
        else f"no extension predicts the thrust of a configuration left out surely better than "
        f"the mean of the others ({mean.rmse:.4f} N): the best, {name}, has {best.rmse:.4f} N, "
        f"{best.low:+.3f} to {best.high:+.3f} N against it"
    )
    first = next(s for s in study.settling if "3200" in s.what and s.what.startswith("thrust"))
    second = next(s for s in study.settling if "4500" in s.what and s.what.startswith("thrust"))
    return (
        f"The model lets thrust fall with softness ({wrong}); measured thrust does not (rank "
        f"correlation with stiffness {study.spearman:.2f}, p = {study.spearman_p:.2f}). Of the "
        f"soft ones the law has an RMS error of {study.rms[law]:.3f} N, their mean "
        f"{study.rms[_THEIRS]:.3f} N; {told}. With deviations of {min(study.deviations):.2f} to "
        f"{max(study.deviations):.2f} N nothing more is certified. It would be settled by "
        f"{first.what} within {first.sigma:.2g} N, or {second.what} within {second.sigma:.2g} N."
    )


def _predictions(points: Points, soft: NDArray[np.bool_], law: str) -> tuple[Prediction, ...]:
    """Leave one soft configuration out after the other; least squares, each counts alike."""
    y = points.readings[:, 0]
    places = np.flatnonzero(soft)
    means = np.array([y[[k for k in places if k != out]].mean() for out in places]) - y[places]
    found = [_compared(_MEAN, means, means, "")]
    bare = predict(points.setup, {})[places, 0] - y[places]
    found.append(_compared(f"law {law} as it is", bare, means, ""))
    for effect in PHYSICAL:
        parameter = STAND_EFFECTS[effect].theta[0]
        values = _grid(parameter)
        table = np.stack([predict(points.setup, {effect: (v,)})[places, 0] for v in values])
        errors = np.where(np.isfinite(table), table - y[places], np.inf)
        left = []
        for k in range(places.size):
            others = np.delete(errors, k, axis=1)
            left.append(float(errors[int(np.argmin((others**2).sum(axis=1))), k]))
        best = values[int(np.argmin((errors**2).sum(axis=1)))]
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        shown = f"{parameter.name} = {best:.3g}{unit}"
        found.append(_compared(effect, np.array(left), means, shown))
    return tuple(sorted(found, key=lambda e: e.rmse))


def _grid(p: StandParam) -> Array:
    """Return values of a parameter within its bounds, its null among them, dense near it."""
    span = abs(p.typical - p.null)
    steps = span * np.sinh(np.linspace(-6.0, 6.0, 1201)) / 10.0
    return np.asarray(np.unique(np.clip(p.null + steps, *p.bounds)))


def _compared(what: str, errors: Array, means: Array, parameter: str) -> Prediction:
    """Return the error left out, and how its square differs from the mean's (t interval)."""
    gap = errors**2 - means**2
    low = high = 0.0
    if np.ptp(gap) > 0.0:
        half = 2.306 * float(gap.std(ddof=1)) / math.sqrt(gap.size)  # t, 8 degrees of freedom
        low, high = (_root(float(gap.mean()) + s * half) for s in (-1.0, 1.0))
    return Prediction(what, float(np.sqrt(np.mean(errors**2))), low, high, parameter)


def _root(square: float) -> float:
    return math.copysign(math.sqrt(abs(square)), square)


def _settling(law: str) -> tuple[Settling, ...]:
    """Simulate the candidates fitted to Table III where they differ, and ask how well to look.

    With one reading of noise sigma, the log Bayes factor between two candidates as fitted is
    their difference squared over 2 sigma^2 on average; sigma is what makes it 4.
    """
    points = table3_points(law)
    soft = np.isfinite(points.stiffness)
    y = points.readings[soft, 0]
    fits: dict[str, dict[str, tuple[float, ...]]] = {"the law as it is": {}}
    for effect in (*_SHAPING, "thrust_coefficient"):
        values = _grid(STAND_EFFECTS[effect].theta[0])
        table = np.stack([predict(points.setup, {effect: (v,)})[soft, 0] for v in values])
        errors = np.where(np.isfinite(table), table - y, np.inf)
        fits[effect] = {effect: (float(values[int(np.argmin((errors**2).sum(axis=1)))]),)}
    found = []
    for conf, channel, rpm, unit in _experiments(law):
        setup = _one(conf, rpm / _RPM, law)
        c = CHANNELS.index(channel)
        scale = math.degrees(1.0) if unit == "deg" else 1.0
        shown = {name: scale * float(predict(setup, v)[0, c]) for name, v in fits.items()}
        true = shown.pop("centrifugal_stiffening")
        gaps = {name: abs(true - other) for name, other in shown.items() if math.isfinite(other)}
        rival = min(gaps, key=lambda name: gaps[name])
        found.append(
            Settling(
                f"{channel} of Conf. {conf} at {rpm:.0f} rpm", rival, gaps[rival],
                gaps[rival] / math.sqrt(2.0 * TELLS), unit, true,
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda s: -s.sigma / max(abs(s.expected), 1e-9)))


def _experiments(law: str) -> list[tuple[int, str, float, str]]:
    result = []
    for conf in (5, 13):
        top = min(valid_speed(configuration(conf), law), SPEED_LIMIT) * _RPM
        for rpm in (3200.0, 4500.0, 6000.0):
            if rpm < top:
                result += [
                    (conf, "thrust", rpm, "N"),
                    (conf, "torque", rpm, "N m"),
                    (conf, "beta", rpm, "deg"),
                ]
    return result


def _one(conf: int, speed: float, law: str) -> Setup:
    row = parameter_row(configuration(conf), law)[None]
    zero = np.zeros(1, np.int64)
    return Setup(np.array([speed]), row, zero, zero, np.zeros(1), law)
