"""Real runs of a quadcopter on a scale: read as they are."""

import time
from pathlib import Path

import pytest

from tombo_diagnosis.stand.diagnose import diagnose_stand
from tombo_diagnosis.stand.tables.table_reader import read_stand

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[6] / "shared" / "data" / "thrust_stand"
FILE = FOLDER / "bitcraze2021_cf21_stock_prop.csv"


@pytest.mark.skipif(not FILE.is_file(), reason=f"real data absent: {FILE}")
def test_a_whole_quadcopter_on_a_scale_gives_its_thrust_constant():
    result = diagnose_stand(
        [read_stand(FILE)], 13, "repaired", False, lambda stage, share: None, time.perf_counter
    )
    k = result.constant
    assert k is not None
    # about 50 g of four rotors at 23 200 rpm by hand: 2.07e-8 N s^2
    assert k.low < k.k_T < k.high
    assert k.k_T == pytest.approx(0.0098 * 51.0 / 4.0 / 2430.0**2, rel=0.03)
    assert 0.002 < (k.high - k.low) / k.k_T < 0.1
    assert abs(k.with_offset / k.k_T - 1.0) > 0.01  # what limits it
    assert result.diagnosis.verdict in ("partly_explained", "unknown", "named")
    assert any("k_T takes up" in note for note in result.diagnosis.notes)
    assert any(f.check == "lag" for f in result.diagnosis.prechecks)
