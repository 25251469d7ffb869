"""Evidence against a nominal model whose slopes are taken as those of the explanation."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tombo_diagnosis.engine.model import Explanation, Hypothesis
from tombo_diagnosis.engine.model_selection import _against_null_alike

CHANGE = -15.0
NULL = SimpleNamespace(evidence=-3800.0)
MODEL = SimpleNamespace(
    null_hypothesis=NULL, relinearized=lambda fit: SimpleNamespace(evidence=fit.evidence + CHANGE)
)
WINNER = Explanation((Hypothesis("imu_bias", (0,)),), None, -4.5, relinearized=True)
RIVAL = replace(WINNER, hypotheses=(Hypothesis("accel_scale", (1,)),), evidence=-10.9)


def test_new_slopes_cost_the_nominal_model_as_much_as_a_cause():
    found, rival = _against_null_alike(MODEL, [WINNER, RIVAL])
    assert found.evidence == pytest.approx(10.5)
    assert found.evidence - rival.evidence == pytest.approx(6.4)
