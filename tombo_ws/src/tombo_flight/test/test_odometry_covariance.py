"""The odometry's covariance against the true errors of the estimate in flight."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_dynamics.rotation import map_to_body, rotation_vector
from tombo_dynamics.time_base import TICK_S
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["hover", "paper_collision", "aggressive"])
def test_variances_are_those_of_the_true_errors(scenario: str) -> None:
    flight = fly_scenario(load_scenario(scenario), 11)
    ticks = np.rint(flight["/odometry"].arrival / TICK_S).astype(int)
    flying = flight.log["position"][ticks, 2] > 0.5  # on the ground the velocity is set to zero
    odometry = {name: one.values[flying] for name, one in flight["/odometry"].items()}
    ticks = ticks[flying]
    names = ("position", "velocity", "attitude", "rates")
    true = {name: flight.log[name][ticks] for name in names}
    velocity = map_to_body(true["attitude"], true["velocity"])
    pairs = zip(true["attitude"], odometry["attitude"], strict=True)
    errors = {
        ("pose_covariance", 0): odometry["position"] - true["position"],
        ("pose_covariance", 21): np.array([rotation_vector(one, other) for one, other in pairs]),
        ("twist_covariance", 0): odometry["velocity"] - velocity,
        ("twist_covariance", 21): odometry["rates"] - true["rates"],
    }
    for (name, element), error in errors.items():
        variance = odometry[name][:, element]
        ratio = np.sqrt(np.mean(error**2) / np.mean(variance))
        assert 0.75 < ratio < 1.35, (name, element, ratio)
        matrix = odometry[name].reshape(-1, 6, 6)
        assert np.array_equal(matrix, np.swapaxes(matrix, 1, 2))
        assert (np.diagonal(matrix, axis1=1, axis2=2) > 0.0).all()
