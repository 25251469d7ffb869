"""The paper's Table III as a stand run: errors of the model, and what to measure to decide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.stand.discriminating_measurements import (
    DiscriminatingMeasurement,
    least_squares_fits,
    settling,
)
from tombo_diagnosis.stand.leave_one_out import MEAN, PHYSICAL, Prediction, predictions
from tombo_diagnosis.stand.tables.assemble import StandData, stiffness
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.wording import display_name
from tombo_dynamics.propeller import RPM, configurations, evaluate, parameter_row
from tombo_dynamics.propeller.effects import CHANNELS, Setup

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
    predictions: tuple[Prediction, ...]
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
    stiff = np.array([stiffness(c) for c in own])
    return OperatingPoints(setup, readings, sigma, ("Table III",) * n, names, stiff)


def table3_assembled(law: str = "repaired") -> StandData:
    """Return Table III as what `diagnose_points` takes."""
    return StandData(table3_points(law), (), ())


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
    fits = least_squares_fits(points)
    rank = stats.spearmanr(points.stiffness[soft], y[soft])
    return Table3(
        tuple(c.number for c in own), tuple(map(float, y)), tuple(map(float, dev)), laws, rms,
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
