"""How cost grows: slopes of known powers, sizes that are left out, the page, each axis once."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from tombo_benchmarks.growth import __main__ as command
from tombo_benchmarks.growth import cost_growth
from tombo_benchmarks.growth.cost_growth import AXES, Axis, Growth, SizeCost, measure, slope
from tombo_benchmarks.growth.growth_page import growth_markdown, growth_page
from tombo_dynamics.errors import InputError


def axis(run, sizes=(1, 10, 100), name="things"):
    return Axis(name, "all of them", "file", sizes, run)


@pytest.fixture
def _loaded(monkeypatch):
    monkeypatch.setattr(cost_growth, "_load", lambda: None)


def test_a_power_is_found_over_the_upper_half_within_its_interval():
    rng = np.random.default_rng(0)
    sizes = [1, 10, 100, 1000, 10_000]

    def readings(size):  # what is paid once hides the power at small sizes
        return 3.0 * size**0.8 * np.exp(rng.normal(0.0, 0.02, 4)) + (50.0 if size < 50 else 0.0)

    fit = slope({size: readings(size).tolist() for size in sizes})

    assert fit.low < 0.8 < fit.high and fit.high - fit.low < 0.05
    assert slope({1: [1.0, 1.0], 2: [0.5, 0.5]}).power == pytest.approx(-1.0)
    assert slope({1: [1.0], 10: [2.0]}) is None
    assert slope({10: [1.0, 1.0, 2.0]}) is None
    assert slope({}) is None


@pytest.mark.usefixtures("_loaded")
def test_sizes_that_time_does_not_allow_are_named():
    def sleep(size):
        time.sleep(1e-3 * size)
        return 1e-3 * size, 1e3 * size

    found = measure(100.0, [axis(sleep, (1, 10, 1_000_000, 10_000_000))])[0]

    assert found.left_out == {1_000_000: "time", 10_000_000: "time"}
    assert found.readings == {size: [SizeCost(1e-3 * size, 1e3 * size)] * 5 for size in (1, 10)}


@pytest.mark.usefixtures("_loaded")
def test_sizes_that_memory_does_not_allow_are_named():
    found = measure(5.0, [axis(lambda size: (1e-3, 1e11 * size))])[0]
    assert found.left_out == {10: "memory", 100: "memory"}


@pytest.mark.slow
@pytest.mark.usefixtures("_loaded")
def test_memory_is_that_of_the_run_and_a_lost_process_is_named():
    def fill(size):
        return 1e-3, np.ones(size).sum() * 0.0 or None

    sizes = (20_000_000, 40_000_000)  # the copy of the process itself takes some MB
    found = measure(20.0, [axis(fill, sizes)])[0]
    held = [found.readings[size][0].size for size in sizes]
    assert held[0] == pytest.approx(1.6e8, rel=0.1) and held[1] == pytest.approx(3.2e8, rel=0.1)

    with pytest.raises(InputError, match="things 1: its process ended with 3"):
        measure(5.0, [axis(lambda size: exit(3))])


@pytest.mark.slow
def test_the_command_prints_and_draws(monkeypatch, tmp_path, capsys):
    rows = {size: [SizeCost(0.1 * size, 2e6 * size)] * 3 for size in (1, 10, 100)}
    growth = Growth(axis(None), rows, {1000: "time"})
    monkeypatch.setattr(command, "measure", lambda seconds, progress: [growth])
    picture = tmp_path / "growth.png"

    command.main(["--json", "--picture", str(picture)])

    data = json.loads(capsys.readouterr().out)["things"]
    assert data["slopes"]["seconds"]["power"] == pytest.approx(1.0)
    assert data["not_run"] == {"1000": "time"}
    line = "1 to 100 | 10 s; 1.00 (1.00 to 1.00) | file: 200 MB; 1.00 (1.00 to 1.00) | 1000 |"
    table = growth_markdown([growth], "growth.png")
    assert line in table and "(growth.png)" in table
    assert picture.read_bytes()[1:4] == b"PNG"
    assert "things 1000: time" in growth_page([growth]).sections[-1].items[0].lines


@pytest.mark.parametrize("seconds", ["0", "nan", "1e7"])
def test_bad_seconds_are_refused(seconds, capsys):
    with pytest.raises(SystemExit):
        command.main(["--seconds", seconds])
    assert "accepted: 1 to 1e6" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("grows", AXES, ids=lambda grows: grows.name)
def test_each_axis_runs_at_its_smallest_size(grows):
    seconds, written = grows.run(grows.sizes[0])
    assert seconds > 0.0
    assert (written is None) == (grows.kept != "file")
