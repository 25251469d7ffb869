"""The steps of the image, run here as far as a machine without a container engine lets them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "docker" / "scripts"


class Box:
    """A folder with tools that are named as the system's and only note how they were called."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.setup = folder / "setup.bash"
        self.setup.write_text('export FROM_ROS="ros $NOT_SET"\n')

    def environment(self, **more: str) -> dict[str, str]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("TOMBO", "AMENT"))}
        path = f"{self.bin}:{os.environ['PATH']}"
        return {**kept, "PATH": path, "ROS_SETUP": str(self.setup), **more}

    def run(
        self, script: str, *arguments: str | Path, **more: str
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [SCRIPTS / script, *arguments],
            env=self.environment(**more),
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=1200,
        )


@pytest.fixture
def box(tmp_path: Path) -> Box:
    return Box(tmp_path)


def test_shellcheck_has_nothing_to_say():
    run = subprocess.run(
        [Path(sys.prefix) / "bin" / "shellcheck", "-x", "-P", SCRIPTS, *SCRIPTS.glob("*.sh")],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout + run.stderr


# --- The workspace ----------------------------------------------------------------------------


BUILT = ("tombo_bag", "tombo_bringup", "tombo_collision", "tombo_sim")


def test_packages_are_built_start_and_list_scenarios(box: Box):
    """The steps build, smoke and entrypoint, with the ROS of this environment for that of apt.

    Other packages and the messages are those of this environment, where the same colcon built all
    of them.
    """
    python, lib = Path(sys.executable), Path(sys.prefix)
    box.setup.write_text(f'export AMENT_PREFIX_PATH="{lib}" PATH="{lib}/bin:$PATH"\n')
    given = {"TOMBO_PYTHON": str(python), "TOMBO_PREFIX": str(box.folder / "install")}
    unused = shutil.ignore_patterns("__pycache__", "test")
    for name in BUILT:
        shutil.copytree(ROOT / "tombo_ws/src" / name, box.folder / "src" / name, ignore=unused)
    built = box.run("30_build.sh", "src", "install", f"-DPython3_EXECUTABLE={python}", **given)
    assert built.returncode == 0, built.stdout[-3000:] + built.stderr[-3000:]
    assert not (box.folder / "build").exists()
    tombo = box.folder / "install/lib/tombo_bringup/tombo"
    assert tombo.read_text().startswith(f"#!{python}\n")

    where = "import tombo_bag, tombo_sim; print(tombo_bag.__file__, tombo_sim.__file__)"
    asked = box.run("entrypoint.sh", python, "-c", where, **given)
    assert asked.returncode == 0, asked.stderr
    assert asked.stdout.count(str(box.folder / "install")) == 2
    flown = box.run("entrypoint.sh", "tombo", "list", "scenarios", **given)
    assert flown.returncode == 0 and "paper_collision" in flown.stdout

    # One that needs no compiled kernels: with changed sources these take their time.
    patient = {"ROS_DOMAIN_ID": "96", "TOMBO_PATIENCE": "120"}
    smoke = box.run("smoke.sh", "detector", **patient, **given)
    assert smoke.returncode == 0, smoke.stderr
    assert "detector_node starts and stops" in smoke.stdout
    share = box.folder / "install/share/tombo_bringup"
    assert {"suite.launch.py", "suite.yaml", "tombo.rviz", "tombo.json"} <= {
        path.name for path in share.rglob("*")
    }


# --- The running container --------------------------------------------------------------------


@pytest.fixture
def sourced(box: Box) -> Box:
    (box.folder / "install").mkdir()
    (box.folder / "install/setup.bash").write_text('export FROM_WORKSPACE="$FROM_ROS too"\n')
    return box


def test_the_entrypoint_sources_and_becomes_the_command(sourced: Box):
    prefix = sourced.folder / "install"
    process = subprocess.Popen(
        [SCRIPTS / "entrypoint.sh", "sh", "-c", 'echo "$$|$FROM_WORKSPACE|$PATH"; exit 7'],
        env=sourced.environment(TOMBO_PREFIX=str(prefix)),
        stdout=subprocess.PIPE,
        text=True,
    )
    out, _ = process.communicate(timeout=60)
    pid, told, path = out.strip().split("|")
    assert int(pid) == process.pid, "signals must reach the command itself"
    assert told == "ros  too"
    assert path.endswith(f":{prefix}/lib/tombo_bringup")
    assert process.returncode == 7


def test_health_is_that_every_node_runs(box: Box):
    zebra = box.bin / "zebra_node"
    zebra.write_text("#!/bin/bash\nsleep 60 & wait\n")
    zebra.chmod(0o755)
    process = subprocess.Popen([zebra, "--ros-args"], start_new_session=True)
    try:
        assert box.run("healthcheck.sh").returncode == 0
        assert box.run("healthcheck.sh", TOMBO_NODES="zebra").returncode == 0
        both = box.run("healthcheck.sh", TOMBO_NODES="zebra okapi")
        assert both.returncode == 1 and "okapi" in both.stdout
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert box.run("healthcheck.sh", TOMBO_NODES="zebra").returncode == 1
