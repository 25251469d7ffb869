"""Public names are documented, typed and quick to import; sweeps, logs and propellers."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tombo
from tombo_dynamics.propeller import RPM, evaluate
from tombo_flight.flight_output import flight_summary

PAGE = Path(__file__).parents[4] / "docs" / "python.md"


def test_the_page_lists_what_is_public():
    table = PAGE.read_text().split("## What is public")[1].split("\n\n")[1]
    named = {name for name in tombo.__all__ if f"`tombo.{name}" in table}
    assert named == set(tombo.__all__)


@pytest.mark.parametrize("name", ["diagnose", "fly", "propeller", "read", "stand", "sweep"])
def test_each_argument_is_typed_and_documented(name):
    function = getattr(tombo, name)
    for argument in inspect.signature(function).parameters.values():
        assert argument.annotation is not inspect.Parameter.empty
        assert f"{argument.name}: " in (function.__doc__ or ""), argument.name
    assert function.__annotations__["return"]


def test_importing_it_loads_neither_tables_nor_compiled_code():
    code = (
        "import sys, tombo\n"
        "slow = {'numba', 'scipy', 'matplotlib', 'pandas', 'pyarrow'}\n"
        "sys.exit(f'loaded: {slow & set(sys.modules)}' if slow & set(sys.modules) else 0)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
def test_a_row_of_a_sweep_is_a_flight(tmp_path):
    axes = {"vehicle.mass": [1.1, 1.3]}
    table = tombo.sweep("hover", axes, range(2), settings={"duration": 1.0}, workers=1)
    assert list(table["vehicle.mass"]) == [1.1, 1.1, 1.3, 1.3]
    assert list(table["seed"]) == [0, 1, 0, 1]
    alone = tombo.fly("hover", seed=1, **{"duration": 1.0, "vehicle.mass": 1.3})
    assert table["max_tilt_rad"].iloc[3] == flight_summary(alone.record)["max_tilt_rad"]
    kept = tombo.sweep(
        "hover", axes, range(2), settings={"duration": 1.0}, workers=1, output=tmp_path / "s"
    )
    walls = ["wall_time_s", "real_time_factor"]
    pd.testing.assert_frame_equal(kept.drop(columns=walls), table.drop(columns=walls))
    assert (tmp_path / "s" / "sweep.html").is_file()


def test_a_table_of_measurements_is_a_log(tmp_path):
    path = tmp_path / "flight.csv"
    t = np.arange(0.0, 5.0, 0.01)
    columns = {"t": t, "x": np.sin(t), "y": 0 * t, "z": 1 + 0 * t}
    columns |= {"qx": 0 * t, "qy": 0 * t, "qz": 0 * t, "qw": 1 + 0 * t}
    pd.DataFrame(columns).to_csv(path, index=False)
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(
        "time: {column: t, unit: s}\nchannels:\n"
        "  position: {columns: [x, y, z], unit: m}\n"
        "  attitude: {columns: [qx, qy, qz, qw], order: xyzw}\n"
    )
    log = tombo.read(path, mapping)
    assert isinstance(log, tombo.Log)
    assert set(log.tables) == set(log.channels) == {"position", "attitude"}
    assert log.tables["position"]["position.x"].to_numpy() == pytest.approx(np.sin(t))
    assert "position" in log._repr_html_()
    with pytest.raises(tombo.InputError, match="accepted"):
        tombo.read(tmp_path / "nothing.mcap")


def test_points_of_a_propeller_are_those_of_the_model():
    table = tombo.propeller(13, [1000.0, 4000.0, 17_000.0])
    assert list(table["valid"]) == [True, True, False]
    assert table["thrust_N"].iloc[1] == evaluate(13, 4000.0 * RPM).thrust_N
    assert np.isnan(table["thrust_N"].iloc[2])
