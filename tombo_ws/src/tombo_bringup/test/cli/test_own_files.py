"""Files of the user on the command line: imported in every process, checked, and named."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys

import pyarrow.parquet as pq
import pytest

from tombo_collision.reactions import REGISTRY
from tombo_flight import own_files

TEXT = '''
from dataclasses import dataclass

import numpy as np
import tombo


@dataclass(frozen=True)
class Mine(tombo.Reaction):
    """Back off."""

    name = "mine"
    wrong: float = tombo.param(0.0, "1", (0.0, 9.0), "how it fails")

    def begin(self, event, estimate, last):
        x_c, n_r = event.contact_position, -event.flight_direction
        if self.wrong == 4.0:
            raise ZeroDivisionError("no way out")
        return {
            0.0: tombo.Decision(x_c, n_r, x_c + 0.8 * n_r),
            1.0: tombo.Decision(x_c, n_r, x_c + 1e9 * n_r),
            2.0: tombo.Decision(x_c, n_r, np.nan * x_c),
            3.0: tombo.Decision(x_c, 2.0 * n_r, x_c + n_r),
            5.0: (x_c, n_r),
        }[self.wrong]
'''
LATE = """
from tombo_dynamics.effects import Param, Stage, effect

@effect("late", Stage.WRENCH, [Param("force", "N", 0.0, (0.0, 1.0), "up", 1.0)], signature="up")
def late(plant, noise, force):
    plant.force[2] += force
"""
BROKEN = {
    "no_name.py": (LATE.replace("+= force", "+= force * nobody"), "'nobody' is not defined"),
    "not_null.py": (LATE.replace("+= force", "+= 1.0 + force"), "when its parameters are null"),
    "no_text.py": (LATE.replace("plant.force", "plant.nothing"), "effect 'late'"),
}
SHORT = ("--set", "duration=12", "--set", "mission.approach_time=6")


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """File with a reaction, in a folder with a space; the registry is as before afterwards."""
    before = dict(REGISTRY)
    monkeypatch.setattr(own_files, "_IMPORTED", {})
    path = tmp_path / "my files" / "yours.py"
    path.parent.mkdir()
    path.write_text(TEXT)
    yield str(path)
    REGISTRY.clear()
    REGISTRY.update(before)


@pytest.mark.slow
def test_an_own_reaction_flies_and_its_scenario_says_how_to_fly_it_again(tombo, mine, tmp_path):
    words = ("fly", "--import", mine, "--reaction", "mine", *SHORT)
    first = tombo(*words, "-o", "one")
    assert first.code == 0, first.err
    head = (tmp_path / "one" / "scenario.yaml").read_text().split("\n")[0]
    again = shlex.split(head.partition("again: ")[2])
    again[again.index("scenario.yaml")] = "one/scenario.yaml"
    assert tombo(*again[1:], "-o", "two").code == 0
    one, two = (json.loads((tmp_path / n / "summary.json").read_text()) for n in ("one", "two"))
    assert one["x_r_m"] == two["x_r_m"] is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "word"),
    [(1, "x_r 1e+09 m"), (2, "x_r [nan"), (3, "n_r ["), (4, "no way out"), (5, "a Decision")],
)
def test_what_can_not_be_flown_ends_the_flight_with_its_reason(tombo, mine, wrong, word):
    setting = ("--set", f"reaction.wrong={wrong}", "-o", "out")
    result = tombo("fly", "--import", mine, "--reaction", "mine", *SHORT, *setting)
    assert result.code == 2
    assert "Traceback" not in result.err
    assert "reaction 'mine': begin() " in result.err and word in result.err
    if wrong == 4:
        assert "yours.py, line " in result.err


@pytest.mark.slow
def test_an_exception_is_the_error_of_its_flight_not_the_end_of_a_sweep(tombo, mine, tmp_path):
    words = ("--import", mine, "--reaction", "mine", *SHORT, "--workers", "2")
    result = tombo("sweep", "paper_collision", "reaction.wrong=0,4", *words, "-o", "s")
    assert result.code == 0, result.err
    assert "1 not flown" in result.out
    good, bad = pq.read_table(tmp_path / "s" / "flights.parquet").column("error").to_pylist()
    assert good is None
    assert "reaction 'mine'" in bad and "no way out" in bad


def test_what_is_no_file_with_a_reaction_is_refused(refused, tmp_path):
    for name, text, word in (
        ("broken.py", "x = (", "SyntaxError"),
        ("fails.py", "1 / 0", "line 1"),
        ("empty.py", "x = 1", "nothing that can be flown"),
        ("late.py", LATE, "import the file first"),
        ("half.py", "import tombo\nclass A(tombo.Reaction):\n    name = 'half'\n", "begin()"),
    ):
        (tmp_path / name).write_text(text)
        refused(("fly", "--import", name), name, word)
    assert "half" not in REGISTRY
    refused(("fly", "--import", "nothere.py"), "nothere.py", "no such file")


@pytest.mark.slow
@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_effect_is_refused_before_it_flies(name, tmp_path):
    text, word = BROKEN[name]
    (tmp_path / name).write_text(text)
    done = subprocess.run(  # of its own: this one has loaded the flight
        [sys.executable, "-m", "tombo_bringup.cli.main", "list", "effects", "--import", name],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert name in done.stderr and word in done.stderr and "Traceback" not in done.stderr
