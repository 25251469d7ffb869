"""`tombo diagnose --explain-mapping`: from a foreign table to a verdict by it alone."""

from __future__ import annotations

import foreign_tables
import pytest

from tombo_diagnosis.diagnosis import VERDICTS


@pytest.mark.slow
def test_from_a_foreign_table_to_a_verdict(tombo, tmp_path):
    (tmp_path / "cf.csv").write_text(foreign_tables.crazyflie())
    printed = tombo("diagnose", "--explain-mapping", "cf.csv")
    assert printed.code == 0, printed.err
    assert [path.name for path in tmp_path.iterdir()] == ["cf.csv"]
    assert tombo("diagnose", "--explain-mapping", "cf.csv", "-o", "m.yaml").code == 0
    assert (tmp_path / "m.yaml").read_text() == printed.out
    verdict = tombo("diagnose", "cf.csv", "--mapping", "m.yaml", "--json")
    assert verdict.code == 0, verdict.err
    assert verdict.json["verdict"] in VERDICTS
    assert verdict.json["vehicle"] == "Crazyflie 2.1"
