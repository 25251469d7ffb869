"""A propeller that changes within a run is found; clean, drifting and bent runs show nothing."""

import numpy as np
import pytest

from tombo_diagnosis.stand.tables.plateaus import find_step, plateaus
from tombo_diagnosis.stand.tables.table_reader import read_stand

UP = np.linspace(0.25, 1.0, 16)
STEP_CASES = {
    "up and down": np.concatenate([UP, UP[-2::-1]]),
    "twice": np.concatenate([UP, UP[-2::-1], UP, UP[-2::-1]]),
    "three sweeps": np.concatenate([UP, UP, UP]),
    "one sweep": np.linspace(0.25, 1.0, 40),
    "at random": np.random.default_rng(1).permutation(np.linspace(0.25, 1.0, 40)),
}
DRIFTS = {
    "nothing": lambda w, e: 0.0 * w,
    "zero wanders": lambda w, e: 0.1 * e,
    "warms up": lambda w, e: 0.08 * w**2 * np.exp(-e / 0.15),
    "comes and goes": lambda w, e: 0.04 * w**2 * np.sin(2.0 * np.pi * e),
    "hysteresis": lambda w, e: 0.03 * w**2 * np.sign(np.gradient(w)),
    "lag": lambda w, e: 0.03 * w * np.sign(np.gradient(w)),
    "stall": lambda w, e: -0.3 * w**2 * np.maximum(w - 0.65, 0.0),
    "resonance": lambda w, e: -0.08 * w**2 * np.exp(-(((w - 0.55) / 0.08) ** 2)),
}


def thrust(w, seed):
    noise = 0.004 * np.random.default_rng(seed).standard_t(6, w.size)
    return w**2 * (1.0 - 0.15 * w**2) + noise


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("way", STEP_CASES)
def test_clean_drifting_and_bent_runs_have_no_step(way, drift):
    w = STEP_CASES[way]
    e = np.linspace(0.0, 1.0, w.size)
    for seed in range(12):
        assert find_step(800.0 * w, thrust(w, seed) + DRIFTS[drift](w, e), e) is None


@pytest.mark.parametrize("size", [-0.15, -0.08, 0.12])
def test_a_chipped_blade_is_found_where_it_chipped(size):
    w = np.tile(STEP_CASES["at random"], 2)
    e = np.linspace(0.0, 1.0, w.size)
    result = 0
    for seed, at in enumerate(range(22, 60, 3)):
        load = thrust(w, seed) * np.where(np.arange(w.size) >= at, 1.0 + size, 1.0)
        step = find_step(800.0 * w, load, e)
        if step is not None:
            result += 1
            assert abs(step.at - at) <= 1
            assert step.size == pytest.approx(size, abs=0.03)
    assert result >= 11


def test_one_sweep_can_not_tell_a_step_from_a_stall():
    w = STEP_CASES["one sweep"]
    load = thrust(w, 0) * np.where(np.arange(w.size) >= 24, 0.85, 1.0)
    assert find_step(800.0 * w, load, np.arange(w.size)) is None


def test_the_shorter_part_is_excluded_and_reported(tmp_path):
    w = np.tile(STEP_CASES["twice"], 2)
    load = thrust(w, 3) * np.where(np.arange(w.size) >= 80, 0.88, 1.0)
    rows = [f"{7000.0 * x:.1f},{y:.5f}" for x, y in zip(w, load, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["rpm,thrust_N", *rows]) + "\n")
    result = plateaus(read_stand(tmp_path / "a.csv"))
    [words] = [f for f in result.findings if f.check == "change"]
    assert "from row 81 on" in words.message and "lower" in words.message
    assert 72 <= result.speed.size <= 80
