"""`tombo risk` on the command line; what it flies: tombo_flight/test/risk."""

from __future__ import annotations

import pytest
from suite_bench import names

SHORT = ("hover", "--set", "duration=0.3", "--workers", "1", "--flights", "100")


@pytest.mark.slow
def test_a_risk_leaves_page_table_and_answer(tombo, tmp_path):
    given = ("--given", "vehicle.mass", "--given", "mission.height~Uniform(1.0,2.0)")
    answer = tombo("risk", *SHORT, *given, "--json").json
    assert answer["probability"] is None and answer["low"] == 0.0
    assert 0.03 < answer["high"] < 0.2 and answer["flights"] == 100
    assert [one["key"] for one in answer["inputs"]] == ["vehicle.mass", "mission.height"]
    folder = tmp_path / "runs" / "risk-hover"
    assert names(folder) == {"flights.parquet", "risk.html", "risk.json"}
    (run,) = tombo("runs", "--json").json
    assert run["kind"] == "risk" and run["outcome"].startswith("no crash found")
    plain = tombo("risk", *SHORT, "-o", "plain")  # nothing but the flights' own draws
    assert plain.code == 0 and "No crash was found in 100" in plain.out
    checked = tombo("risk", *SHORT, "-o", "plain", "--check", "100")
    assert "100 of 200 flights are there" in checked.out + checked.err
    assert "The two agree" in checked.out
    assert "No crash was found in 100" in (folder / "risk.html").read_text()
