"""Measurements that would decide Table III: where the fitted candidates differ most."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.engine.verdict import LOG_BF_DISTINCT
from tombo_diagnosis.stand.leave_one_out import least_squares_fit
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM, SPEED_LIMIT, configuration, parameter_row, valid_speed
from tombo_dynamics.propeller.effects import CHANNELS, Setup, predict

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
    found = {effect: predict(setup, {effect: (value,)}) for effect, value in fits.items()}
    return {AS_IT_IS: predict(setup, {})} | found


def settling(fits: dict[str, float], law: str) -> tuple[DiscriminatingMeasurement, ...]:
    """Simulate the candidates where they differ, and ask how well to look; easiest first.

    With one reading of noise sigma, the log Bayes factor between two candidates as fitted is
    their difference squared over 2 sigma^2 on average; sigma is what makes it 4.
    """
    found = []
    for conf, channel, rpm, unit in _experiments(law):
        c = CHANNELS.index(channel)
        scale = math.degrees(1.0) if unit == "deg" else 1.0
        every = predicted_readings(fits, conf, np.array([rpm]), law)
        shown = {name: scale * float(values[0, c]) for name, values in every.items()}
        true = shown.pop("centrifugal_stiffening")
        gaps = {name: abs(true - other) for name, other in shown.items() if math.isfinite(other)}
        rival = min(gaps, key=lambda name: gaps[name])
        found.append(
            DiscriminatingMeasurement(
                f"{channel} of Conf. {conf} at {rpm:.0f} rpm", rival, gaps[rival],
                gaps[rival] / math.sqrt(2.0 * LOG_BF_DISTINCT), unit, true,
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda s: -s.sigma / max(abs(s.expected), 1e-9)))


def _experiments(law: str) -> list[tuple[int, str, float, str]]:
    return [
        (conf, channel, rpm, unit)
        for conf in (5, 13)
        for rpm in (3200.0, 4500.0, 6000.0)
        if rpm < min(valid_speed(configuration(conf), law), SPEED_LIMIT) / RPM
        for channel, unit in (("thrust", "N"), ("torque", "N m"), ("beta", "deg"))
    ]
