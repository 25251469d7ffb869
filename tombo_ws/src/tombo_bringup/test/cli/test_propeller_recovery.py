"""`tombo propeller recovery`: files and words out, refusals in."""

from __future__ import annotations

import math

import numpy as np
import pytest
from suite_bench import names


def write_trace(path, tau=0.15, level=6.0, unit="thrust_N"):
    t = np.arange(3000) * 1e-3
    folded = np.where(t < 1.0, 0.0, np.exp(-(t - 1.0) / tau))
    value = level * (1.0 - folded) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    lines = [f"time,{unit}", *(f"{a:.4f},{b:.5f}" for a, b in zip(t, value, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return tau * math.log(10.0)


def write_flat(folder):
    rows = "".join(f"{k / 1000},5.0\n" for k in range(500))
    (folder / "flat.csv").write_text("time,thrust\n" + rows)


@pytest.mark.slow
def test_a_trace_gives_its_recovery_time(tombo, tmp_path):
    truth = write_trace(tmp_path / "t.csv")
    result = tombo("propeller", "recovery", "t.csv", "-o", "out")
    assert result.code == 0, result.err
    assert "1 collision" not in result.err
    assert names(tmp_path / "out") == {"recovery.json", "recovery.png"}
    (values,) = tombo("propeller", "recovery", "t.csv", "--json").json["collisions"]
    assert values["low_s"] <= truth <= values["high_s"]
    assert values["time_s"] == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize(
    "arguments, why",
    [
        (["none.csv"], "can't read"),
        (["t.csv", "--column", "thurst_N"], "thrust_N"),
        (["t.csv", "--tare", "7"], "tare too large"),
        (["flat.csv"], "no collision"),
    ],
)
def test_bad_traces_are_refused(refused, tmp_path, arguments, why):
    write_trace(tmp_path / "t.csv")
    write_flat(tmp_path)
    refused(("propeller", "recovery", *arguments, "-o", "out"), why)


@pytest.mark.slow
def test_a_speed_trace_says_at_least(tombo, tmp_path):
    write_trace(tmp_path / "t.csv", level=4507.0, unit="rpm")
    text = tombo("propeller", "recovery", "t.csv").out
    assert "from 4507: recovered after at least 0.4" in text
    assert "lower bound" in text
    values = tombo("propeller", "recovery", "t.csv", "--json").json
    assert (values["trace"], values["lower_bound"]) == ("rpm", True)
    (hit,) = values["collisions"]
    assert hit["level"] == pytest.approx(4507.0, rel=0.01)
    assert hit["words"].startswith("at least")
