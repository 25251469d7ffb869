"""The examples of all pages and of CONTRIBUTING do as they are printed what the page says.

Python runs, in a folder of its own, block after block of a page. A file that the page asks to save
is there for its commands, which are run, too. YAML is read by what reads such a file.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tombo_diagnosis.stand.tables import table_reader
from tombo_flight.scenario import load_scenario
from tombo_flight.sweep.design import SweepDesign
from tombo_flight.sweep.study import new_sweep
from tombo_flight.vehicle_file import vehicle_from_text
from tombo_logs.readers.csv_mapping import parse_mapping

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
TEXTS = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
SAVED = re.compile(r"Save as `([\w.]+)`:\n\n```\w+\n(.*?)^```", re.M | re.S)


def blocks(name: str, language: str, text: str | None = None) -> list[str]:
    text = TEXTS[name] if text is None else text
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S)


def pages(language: str) -> list[str]:
    """Return the pages with blocks that are not saved as files."""
    return [name for name, text in TEXTS.items() if blocks(name, language, SAVED.sub("", text))]


COMPILED = """
import numpy, rope
from tombo_dynamics.effects.compose import new_plant
from tombo_dynamics.vehicle import VehicleParams

plant = new_plant(VehicleParams())
plant.state.position[2] = 2.0
rope.rope(plant, numpy.zeros(4), 80.0, 0.5)
assert plant.force.tolist() == [0.0, 0.0, -120.0], plant.force
"""
"""The effect of CONTRIBUTING as machine code, alone: with a flight's loop it takes a minute."""


def run(words: list[str], folder: Path, **environment: str) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        words, cwd=folder, env=os.environ | {"PATH": path} | environment, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", pages("python"))
def test_python_runs(name, tmp_path):
    printed = blocks(name, "python", SAVED.sub("", TEXTS[name]))
    installed = [
        block
        for block in printed
        if all(importlib.util.find_spec(m) for m in re.findall(r"^(?:from|import) (\w+)", block))
    ]
    (tmp_path / "page.py").write_text("\n\n".join(installed), encoding="utf-8")
    run([sys.executable, "page.py"], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, text in TEXTS.items() if SAVED.search(text)])
def test_saved_files_fly_with_the_commands_of_the_page(name, tmp_path):
    for file, block in SAVED.findall(TEXTS[name]):
        (tmp_path / file).write_text(block, encoding="utf-8")
    commands = "".join(block for block in blocks(name, "sh") if block.startswith("tombo "))
    if name == "CONTRIBUTING.md":
        run([sys.executable, "-c", COMPILED], tmp_path)
        climb = f"{commands.rstrip()} --set duration=5"
        run(["bash", "-e", "-c", climb], tmp_path, NUMBA_DISABLE_JIT="1")
    else:
        run(["bash", "-e", "-c", commands], tmp_path)
    summaries = {p.parent.name: json.loads(p.read_text()) for p in tmp_path.rglob("summary.json")}
    if name == "own_collision.md":
        post, up = summaries["post"], summaries["up"]
        assert post["collided"] and up["reaction"] == "back_and_up"
        assert up["x_r_m"][2] - up["x_c_m"][2] == pytest.approx(0.4, abs=0.01)
    if name == "CONTRIBUTING.md":
        from tombo_bag.recording import Recording

        (recorded,) = tmp_path.rglob("flight.mcap")
        with Recording(recorded) as recording:
            height = recording.columns("/ground_truth/odometry")["pose.pose.position.z"]
        assert 0.4 < height.max() < 1.2, "the rope has not held the vehicle down"


@pytest.mark.parametrize("name", pages("yaml"))
def test_yaml_is_accepted(name, tmp_path):
    for block in blocks(name, "yaml", SAVED.sub("", TEXTS[name])):
        keys = set(yaml.safe_load(block))
        file = tmp_path / "page.yaml"
        file.write_text(block if keys & {"extends", "cases"} else f"extends: hover\n{block}")
        if "cases" in keys:
            new_sweep(str(file), SweepDesign(()), range(1))
        elif "tombo_vehicle" in keys:
            vehicle_from_text(block, name)
        elif {"channels", "model"} <= keys:
            table_reader.parse_mapping(block, name)
        elif "channels" in keys:
            parse_mapping(block, name)
        else:
            load_scenario(str(file))
