import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

SCRIPTS = Path(__file__).parents[1] / "scripts"


@pytest.fixture(scope="module")
def robustness():
    spec = importlib.util.spec_from_file_location(
        "propeller_robustness", SCRIPTS / "propeller_robustness.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("law", ["repaired", "consistent"])
def test_a_slice_of_the_robustness_run(robustness, law: str) -> None:
    counts = robustness.check(law, 4000, 3, 1000)
    assert counts.valid + counts.beyond + counts.lost == counts.sets == 4000
    assert counts.valid > 2000
    assert counts.bare == 0
    assert counts.against_path == 0
    assert counts.residual < 1e-11
    assert counts.apart < 1e-9
    ratio, jump = robustness.continuity(law, 10, 3)
    assert 0.9 < ratio < 1.1
    assert 0.0 < jump < 0.1


def test_the_residual_sees_an_angle_that_is_off(robustness) -> None:
    rng = np.random.default_rng(0)
    changes = robustness.random_changes(rng, 50, "repaired")
    rows = robustness.parameter_rows(13, "repaired", **changes)
    points = robustness.evaluate_rows(rows, 200.0, "repaired", "keep")
    points.alpha_rad[:] += 1e-6
    left = robustness.residual(rows, changes, points, "repaired")[points.valid]
    assert (left > 5e-7).all()
