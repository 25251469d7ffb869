"""A sixth core by --import of its file: the same bits wherever it is flown."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ros_bench import domain, start

__all__ = ["domain", "start"]
HERE = Path(__file__).parent


def with_core(file: str, module: str) -> tuple[str, ...]:
    return ("tombo_flight.own_files", str(HERE / file), "--", module)


def run(file: str, folder: Path, *ways: str) -> None:
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", *with_core(file, "wind_flights"), str(folder), *ways],
        env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wind")
    run("wind_core.py", folder, "compiled", "batch", "replay", "parameters")
    return folder


@pytest.mark.slow
def test_its_wind_is_that_of_the_flight(flown):
    seconds, east, north = np.load(flown / "compiled.npy")[:, [0, 8, 9]].T * [[1e-9], [1.0], [1.0]]
    flies = (seconds > 3.0) & (seconds < 5.0)  # before the collision
    assert flies.sum() == 99
    assert east[flies].mean() == pytest.approx(1.5, abs=0.2)
    assert north[flies].mean() == pytest.approx(0.0, abs=0.2)


@pytest.mark.slow
def test_a_batch_and_the_replay_give_the_same_bits(flown):
    compiled, batch, replay = (
        np.load(flown / f"{way}.npy") for way in ("compiled", "batch", "replay")
    )
    assert np.array_equal(replay, compiled)
    assert np.array_equal(batch[0], compiled[compiled[:, 0] == batch[0, 0]][0])


@pytest.mark.slow
def test_plain_python_gives_the_same_bits(flown, tmp_path):
    run("wind_in_python.py", tmp_path, "compiled")
    assert np.array_equal(np.load(tmp_path / "compiled.npy"), np.load(flown / "compiled.npy"))


@pytest.mark.slow
def test_nodes_in_lockstep_give_the_same_bits(flown, start):
    pytest.importorskip("rclpy")
    from tombo_flight.suite.nodes import HOST, SUITE

    file = ("--params-file", str(flown / "parameters.yaml"))
    nodes = {name: start(module, *file) for name, module in SUITE.items()}
    nodes["wind"] = start(" ".join(with_core("wind_core.py", HOST)), "-p", "core:=wind", *file)
    assert nodes["sim"].process.wait(200.0) == 0, nodes["sim"].output
    assert nodes["recorder"].end() == 0
    run("wind_core.py", flown, "nodes")
    assert np.array_equal(np.load(flown / "nodes.npy"), np.load(flown / "compiled.npy"))
