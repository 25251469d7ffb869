"""How large a change of a parameter must be before data like these show it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tombo_diagnosis.engine.evidence import solve
from tombo_diagnosis.engine.model import Model
from tombo_diagnosis.engine.model_selection import LOG_BF_FIRST
from tombo_diagnosis.engine.regression import Fit


@dataclass(frozen=True)
class Detectable:
    """The smallest change of a parameter that data would have shown."""

    parameter: str
    unit: str
    size: float


def detectable_changes(model: Model, fit: Fit) -> dict[str, Detectable]:
    """Return effect -> the parameter that shows best in its scale, and how small it may be.

    A change is shown if the log Bayes factor of "as wide as what matters" against "within its
    tolerance" is expected to reach the threshold of a cause. All other parameters are within
    their tolerances. Gaussian, about the fit given.
    """
    best: dict[str, tuple[float, Detectable]] = {}
    columns = model.columns
    for index in columns.identifiable:
        p, (place,) = columns.parameters[index], columns.places([index])
        deviations = columns.deviations((*fit.free, index), fit.widths, pinned=fit.pinned)
        variance = float(solve(fit.normal, deviations, fit.prior_mean).covariance[place, place])
        noise = 1.0 / max(1.0 / max(variance, 1e-300) - p.scale**-2, 1e-300)
        size = _threshold(math.sqrt(noise), p.tolerance, p.scale, len(columns.variants[p.effect]))
        share = size / p.scale
        if p.effect not in best or share < best[p.effect][0]:
            best[p.effect] = share, Detectable(p.name, p.unit, size)
    return {effect: found for effect, (_, found) in best.items()}


def _threshold(noise: float, tolerance: float, scale: float, variants: int) -> float:
    """Return the size at which a parameter measured with this noise is accepted as a cause."""
    healthy, wide = noise**2 + tolerance**2, noise**2 + scale**2
    needed = LOG_BF_FIRST + math.log(max(variants, 1)) + 0.5 * math.log(wide / healthy)
    return math.sqrt(2.0 * needed / (1.0 / healthy - 1.0 / wide))
