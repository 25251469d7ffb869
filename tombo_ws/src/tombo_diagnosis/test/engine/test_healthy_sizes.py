"""A healthy size is not a cause: tolerances that are known badly, and causes that are rare."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tombo_diagnosis.engine.model import Setting
from tombo_diagnosis.engine.model_selection import search
from tombo_diagnosis.engine.regression import (
    NOMINAL_WIDTHS,
    Fit,
    FreeParameter,
    NormalEquations,
    Unknowns,
    solve,
)

NOISE = 0.05
"""Deviation with which the data show each parameter; sizes that matter are 1, tolerances 0.05."""
MASS = FreeParameter(0, "mass_error", "fraction", "1", 0.0, -9.0, 9.0, 1.0)
SHIFT = FreeParameter(1, "cog_offset", "x", "m", 0.0, -9.0, 9.0, 1.0)


@dataclass
class Linear:
    """Data that show parameters as they are, with noise."""

    sizes: tuple[float, ...]
    tolerance_inflation: float = 1.0
    log_prior_cost: float = 0.0

    def __post_init__(self):
        parameters = tuple(
            replace(p, tolerance_inflation=self.tolerance_inflation) for p in (MASS, SHIFT)
        )
        self.unknowns = Unknowns(parameters, (0, 1), draw_inflation=self.tolerance_inflation)
        self.setting = Setting(4, 0.05, {}, log_prior_cost=self.log_prior_cost)
        self.theta = np.zeros(2)
        weights, values = np.eye(2) / NOISE**2, np.array(self.sizes)
        vector = weights @ values
        self.normal = NormalEquations(weights, vector, float(values @ vector))
        self.null_hypothesis = self.fit((), NOMINAL_WIDTHS, None)

    def noise_effects(self):
        return {}

    def fit(self, free, widths, start):
        solution = solve(self.normal, self.unknowns.deviations(free, widths))
        theta = np.where(np.isin([0, 1], free), solution.mean, 0.0)
        # The tangent stays that of the nominal model, so what is left to do is the solution.
        zero = replace(solution, mean=solution.mean - theta)
        return Fit(tuple(free), widths, theta, np.zeros(2), zero, self.normal,
                   solution.evidence, None)  # fmt: skip

    def relinearized(self, fit):
        return fit


def causes(*sizes, **settings):
    return set(search(Linear(sizes, **settings)).best.effects)


@pytest.mark.parametrize(("size", "known", "doubted"), [(0.0, set(), set()),
    (0.28, {"mass_error"}, set()), (0.8, {"mass_error"}, {"mass_error"})])  # fmt: skip
def test_a_size_that_a_wider_tolerance_makes_healthy_is_no_cause(size, known, doubted):
    assert causes(size, 0.0) == known
    assert causes(size, 0.0, tolerance_inflation=2.5) == doubted


def test_small_differences_of_all_are_no_large_one_of_one():
    """That the vehicle varies more than its few flights show explains them together."""
    assert causes(0.26, 0.24) == {"mass_error"}
    assert causes(0.26, 0.24, tolerance_inflation=2.5) == set()


def test_where_causes_are_rare_evidence_has_to_be_stronger():
    assert causes(0.26, 0.0) == {"mass_error"}
    assert causes(0.26, 0.0, log_prior_cost=math.log(40)) == set()
    assert causes(0.60, 0.0, log_prior_cost=math.log(40)) == {"mass_error"}
