"""A file added to the other effects: other machine code, or named where it is broken.

That it acts, tests/structure/test_additions.py and the example of CONTRIBUTING.md show. A copy of
the package runs in a process of its own, uncompiled, so that it starts in a second.
"""

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

@effect("rope", Stage.WRENCH, [Param("stiffness", "N/m", 0.0, (0.0, 1e4), "of the rope", 50.0)],
        signature="force downwards once the rope is taut", separates_from={})
def rope(plant, noise, stiffness):
    """Pull an upright vehicle down once it is higher than 5 m."""
    plant.force[2] -= stiffness * max(0.0, plant.state.position[2] - 5.0)
'''
CACHE = """
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.jit import CACHE_FOLDER
print(CACHE_FOLDER.name, "rope" in REGISTRY)
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run `CACHE` with another text of the effect's file; return its output, and the error."""
    folder = tmp_path_factory.mktemp("workspace")
    package = folder / "tombo_dynamics"
    shutil.copytree(
        Path(tombo_dynamics.__file__).parent, package,
        ignore=shutil.ignore_patterns("__pycache__"),
    )  # fmt: skip
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {
        "PYTHONPATH": path, "TOMBO_CACHE_DIR": str(folder / "cache"), "NUMBA_DISABLE_JIT": "1",
    }  # fmt: skip

    def run(source=None):
        if source is not None:
            (package / "effects" / "rope.py").write_text(source)
        return subprocess.run(
            [sys.executable, "-c", CACHE], env=environment, capture_output=True, text=True,
            timeout=60, cwd=folder,
        )  # fmt: skip

    return run


def test_machine_code_of_other_sources_is_not_reused(run):
    """Sources differ by an added effect file, or by the text of that file."""
    edited = ROPE.replace("stiffness * max", "1.0 * stiffness * max")
    runs = [run(), run(ROPE), run(edited), run(ROPE)]
    caches, known = zip(*(done.stdout.split() for done in runs), strict=True)
    assert known == ("False", "True", "True", "True")
    assert len(set(caches)) == 3 and caches[1] == caches[3]


def test_a_broken_file_is_named_in_one_line(run):
    broken = run(f"nobody{ROPE}").stderr.splitlines()[-1]
    assert "InputError" in broken and "effects/rope.py" in broken and "line " in broken
