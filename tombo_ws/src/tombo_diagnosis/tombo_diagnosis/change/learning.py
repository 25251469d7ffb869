"""How far changes are from what candidates predict: learnt from flights of known changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from tombo_diagnosis.change.likelihood import GUESSED, Widths, log_density, size_prior
from tombo_diagnosis.change.signatures import ChangeCandidate
from tombo_dynamics.arrays import Array

_FACTOR: Final = math.log(2.0)
"""Spread of the logarithm of a width about what is guessed."""
_FARTHEST: Final = 2.0
"""Largest change of that logarithm."""


@dataclass(frozen=True)
class KnownChange:
    """New flights whose change is known, against healthy ones."""

    scale: Array
    """(9, 9) of what healthy flights would be, a Student's t."""
    degrees: float
    """Of freedom."""
    shift: Array
    """(9,) new minus healthy, as `Features.vector`."""
    causes: tuple[ChangeCandidate, ...]
    """What was done; of several, one of them."""


def learnt_widths(known: Sequence[KnownChange], guess: Widths = GUESSED) -> Widths:
    """Return the most probable widths after flights of known changes.

    Before them each width is log-normal about what is guessed. A change has any usual size.
    """
    first = np.array(astuple(guess))

    def unlikely(change: Array) -> float:
        widths = Widths(*(first * np.exp(change)).tolist())
        logs = [
            logsumexp([_of_any_size(each, cause, widths) for cause in each.causes])
            for each in known
        ]
        return 0.5 * float(np.sum((change / _FACTOR) ** 2)) - float(np.sum(logs))

    bounds = [(-_FARTHEST, _FARTHEST)] * first.size
    best = minimize(unlikely, np.zeros(first.size), method="L-BFGS-B", bounds=bounds)
    return Widths(*(first * np.exp(best.x)).tolist())


def _of_any_size(known: KnownChange, cause: ChangeCandidate, widths: Widths) -> float:
    log = log_density(known.scale, known.degrees, known.shift, cause, widths)
    return float(logsumexp(log, b=size_prior(cause)))
