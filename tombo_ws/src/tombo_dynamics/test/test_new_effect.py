"""A file dropped beside the others is an effect: composed, checked, flown; nothing else is edited.

The copy of the package runs in a process of its own, uncompiled, so that it starts in a second.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import tombo_dynamics

pytestmark = pytest.mark.slow

ROPE = '''
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.records import Record, field

class RopeState(Record):
    tightenings = field("1", "how often it has become taut", kind=int)
    taut = field("1", "it is", kind=bool)

@effect("rope", Stage.WRENCH, [Param("stiffness", "N/m", 0.0, (0.0, 1e4), "of the rope", 50.0)],
        signature="force downwards once the rope is taut", separates_from={}, state=RopeState)
def rope(plant, noise, state, stiffness):
    """Pull an upright vehicle down once it is higher than 5 m."""
    stretch = plant.state.position[2] - 5.0
    plant.force[2] -= stiffness * max(0.0, stretch)
    state.tightenings += stretch > 0.0 and not state.taut
    state.taut = stretch > 0.0
'''

FLY = """
import json
import numpy as np
from tombo_dynamics.effects import REGISTRY, check_theta
from tombo_dynamics.effects.compose import new_plant, pack_theta
from tombo_dynamics.jit import CACHE_FOLDER
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vehicle import VehicleParams

def flown(values):
    theta, maps = pack_theta(check_theta(values, "effects")), RotorMaps.new()
    maps.step = maps.inverse_step = 1.0
    plant = new_plant(VehicleParams())
    plant.state.position[2] = 7.0
    begin_flight(plant, np.zeros(9), theta, 1e-3)
    for _ in range(10):
        begin_tick(plant, maps, np.zeros(9), theta)
        finish_tick(plant, np.zeros(9), theta)
    return plant

seen = {"cache": CACHE_FOLDER.name, "free": flown({}).state.velocity[2]}
if "rope" in REGISTRY:
    plant = flown({"rope": {"stiffness": 65.0}})
    seen |= {"held": plant.state.velocity[2], "taut": int(plant.memories.rope.tightenings)}
print(json.dumps(seen))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace")
    package = folder / "tombo_dynamics"
    shutil.copytree(
        Path(tombo_dynamics.__file__).parent, package,
        ignore=shutil.ignore_patterns("__pycache__"),
    )  # fmt: skip

    def run(source=None, *, fails=False):
        if source is not None:
            (package / "effects" / "rope.py").write_text(source)
        path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {
            "PYTHONPATH": path, "TOMBO_CACHE_DIR": str(folder / "cache"), "NUMBA_DISABLE_JIT": "1",
        }  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", FLY], env=environment, capture_output=True, text=True,
            timeout=60, cwd=folder,
        )  # fmt: skip
        assert (done.returncode != 0) == fails, done.stderr
        if fails:
            return done.stderr.splitlines()[-1]
        return json.loads(done.stdout)

    return run


@pytest.fixture(scope="module")
def without(run):
    return run()


@pytest.fixture(scope="module")
def with_rope(run, without):
    return run(ROPE)


def test_new_effect_acts_and_remembers_and_is_absent_at_null(without, with_rope):
    assert with_rope["free"] == without["free"] == pytest.approx(-0.0980665)
    pull = 65.0 * 2.0 / 1.3  # N/m times m of stretch over mass
    assert with_rope["held"] - with_rope["free"] == pytest.approx(-pull * 0.01, rel=1e-3)
    assert with_rope["taut"] == 1


def test_machine_code_of_other_sources_is_not_reused(run, without, with_rope):
    """Neither of a file that was not there, nor of one that read otherwise."""
    edited = run(ROPE.replace("stiffness * max", "1.0 * stiffness * max"))
    assert len({without["cache"], with_rope["cache"], edited["cache"]}) == 3
    assert run(ROPE)["cache"] == with_rope["cache"]


def test_a_broken_file_is_named_in_one_line(run, with_rope):
    broken = run(f"nobody{ROPE}", fails=True)
    assert "InputError" in broken and "effects/rope.py" in broken and "line " in broken
    run(ROPE)
