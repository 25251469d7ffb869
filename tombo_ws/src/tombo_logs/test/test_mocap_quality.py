"""Mistakes of a motion capture are named, and a good one has none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mocap_mistakes import MISTAKES, made

from tombo_bag.flight import Flight, Series
from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_logs.mocap_quality import check_mocap
from tombo_logs.readers.log_reader import read_logs

_REAL = sorted(Path(__file__).parents[5].glob("shared/data/flights/*.csv.gz"))
_NOISE = ("effects.mocap_noise.position=2e-4", "effects.mocap_noise.attitude=2e-3")
_CASES = ["simulated", *(path.name.split(".")[0] for path in _REAL)]


def _simulated() -> Flight:
    flight = fly_scenario(load_scenario("survey", _NOISE), 1)
    keep = ("position", "attitude", "gyro", "accel")
    channels = {name: s for name, s in flight.series.items() if name in keep}
    return Flight.measured("simulated", "", channels)


@pytest.fixture(scope="module", params=_CASES)
def log(request) -> Flight:
    if request.param == "simulated":
        return _simulated()
    (path,) = (path for path in _REAL if path.name.startswith(request.param))
    return read_logs([path])[0]


def test_a_good_recording_has_no_findings(log):
    assert check_mocap(log).findings == {}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named(log, mistake):
    key, change = MISTAKES[mistake]
    assert key in check_mocap(made(change, log)).findings


def test_figures_are_those_that_were_put_in():
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 0.01)
    late = 0.008 + 0.002 * rng.random(t.size)
    path = np.where(t < 5.0, 0.0, 1.5 * np.sin(0.8 * (t - 5.0)))
    values = np.column_stack([path, 0.5 * path, 1.0 + 0.0 * t])
    values += 1e-3 / np.sqrt(3.0) * rng.standard_normal(values.shape)
    level = np.tile([0.0, 0.0, 0.0, 1.0], (t.size, 1))
    kept = np.ones(t.size, bool)
    kept[1200:1220] = False
    position = Series(t[kept], values[kept], (t + late)[kept])
    series = {"position": position, "attitude": replace(position, values=level[kept])}
    quality = check_mocap(Flight.measured("made", "", series))
    figures = quality.figures
    assert figures["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    assert figures["latency_p50_ms"] == pytest.approx(9.0, abs=0.2)
    assert figures["noise_position_mm"] == pytest.approx(1.0, rel=0.15)
    assert figures["longest_gap_s"] == pytest.approx(0.21, abs=0.011)
    assert figures["dropouts"] == 1
    assert figures["x_max_m"] == pytest.approx(1.5, abs=0.02)


def test_a_recording_without_poses_is_refused():
    t = np.arange(100.0)
    gyro = {"gyro": Series(t, np.zeros((100, 3)))}
    with pytest.raises(InputError, match="position and attitude of a body"):
        check_mocap(Flight.measured("bare", "", gyro))
