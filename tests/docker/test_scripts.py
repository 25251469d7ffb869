"""The steps of the image, run here as far as a machine without a container engine lets them."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "docker" / "scripts"
TEST_ONLY = {"python3-hypothesis", "python3-pytest"}
PIP_NAME = {"python3-pil": "pillow", "python3-yaml": "pyyaml", "mcap-ros2-support": "mcap"}


class Box:
    """A folder with tools that are named as the system's and only note how they were called."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.setup = folder / "setup.bash"
        self.setup.write_text('export FROM_ROS="ros $NOT_SET"\n')

    def tool(self, name: str, does: str = "") -> None:
        path = self.bin / name
        path.write_text(f'#!/bin/bash\necho "{name} $*" >>"{self.folder}/calls"\n{does}\n')
        path.chmod(0o755)

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

    def calls(self) -> list[str]:
        return (self.folder / "calls").read_text().splitlines()


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


# --- Debian packages --------------------------------------------------------------------------


def skipped(box: Box) -> list[str]:
    for name in ("apt-get", "rosdep"):
        box.tool(name)
    run = box.run("10_system.sh", ROOT / "tombo_ws" / "src")
    assert run.returncode == 0, run.stderr
    (call,) = (line for line in box.calls() if line.startswith("rosdep"))
    assert f"--from-paths {ROOT}/tombo_ws/src --ignore-src" in call
    return call.partition("--skip-keys ")[2].split()


def test_rosdep_is_asked_for_all_but_the_python_libraries_which_are_pinned(box: Box):
    keys = set(skipped(box))
    manifests = "".join(p.read_text() for p in ROOT.glob("tombo_ws/src/*/package.xml"))
    wanted = set(re.findall(r"depend>([\w-]+)</", manifests))
    assert keys == {k for k in wanted if k.startswith("python3-")} | {"mcap-ros2-support"}
    pins = {line.partition("==")[0].lower() for line in pinned(box)}
    names = (
        PIP_NAME.get(k, k.removeprefix("python3-").removesuffix("-pip")) for k in keys - TEST_ONLY
    )
    assert set(names) <= pins
    assert not {n for n in pins if n.startswith("ros-")} | {"empy", "lark-parser"} & pins


# --- Python libraries -------------------------------------------------------------------------

VENV_MAKER = """
mkdir -p "${@: -1}/bin"
printf '#!/bin/bash\\necho "pip $*" >>"{folder}/calls"' >"${@: -1}/bin/python"
chmod +x "${@: -1}/bin/python"
"""


def pinned(box: Box) -> list[str]:
    box.tool("python3", VENV_MAKER.replace("{folder}", str(box.folder)))
    run = box.run("20_python.sh", ROOT / "requirements.txt", "venv")
    assert run.returncode == 0, run.stderr
    assert "python3 -m venv --system-site-packages venv" in box.calls()
    assert any("pip -m pip install" in line for line in box.calls())
    lines = (box.folder / "venv/requirements.txt").read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


# --- The workspace ----------------------------------------------------------------------------


CMAKE_PACKAGE = """cmake_minimum_required(VERSION 3.21)
project(tombo_probe)
file(WRITE ${CMAKE_BINARY_DIR}/told "${Python3_EXECUTABLE} ${CMAKE_BUILD_TYPE} ${BUILD_TESTING}")
install(FILES ${CMAKE_BINARY_DIR}/told DESTINATION share/tombo_probe)
"""
MANIFEST = """<package format="3"><name>tombo_probe</name><version>1.0.0</version>
<description>What CMake was told</description><maintainer email="a@b.invalid">a</maintainer>
<license>MIT</license><export><build_type>cmake</build_type></export></package>
"""


BUILT = ("tombo_bag", "tombo_bringup", "tombo_collision", "tombo_sim")


def test_packages_are_built_start_and_list_scenarios(box: Box):
    """The steps build, smoke and entrypoint, with the ROS of this environment for that of apt.

    Other packages and the messages are those of this environment, where the same colcon and CMake
    built all of them; a small package shows what CMake is told.
    """
    python, lib = Path(sys.executable), Path(sys.prefix)
    box.setup.write_text(f'export AMENT_PREFIX_PATH="{lib}" PATH="{lib}/bin:$PATH"\n')
    given = {"TOMBO_PYTHON": str(python), "TOMBO_PREFIX": str(box.folder / "install")}
    unused = shutil.ignore_patterns("__pycache__", "test")
    for name in BUILT:
        shutil.copytree(ROOT / "tombo_ws/src" / name, box.folder / "src" / name, ignore=unused)
    probe = box.folder / "src" / "tombo_probe"
    probe.mkdir()
    (probe / "CMakeLists.txt").write_text(CMAKE_PACKAGE)
    (probe / "package.xml").write_text(MANIFEST)
    built = box.run("30_build.sh", "src", "install", f"-DPython3_EXECUTABLE={python}", **given)
    assert built.returncode == 0, built.stdout[-3000:] + built.stderr[-3000:]
    assert not (box.folder / "build").exists()
    told = (box.folder / "install/share/tombo_probe/told").read_text()
    assert told == f"{python} Release OFF"
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


def test_the_entrypoint_stops_without_a_workspace(box: Box):
    run = box.run("entrypoint.sh", "echo", "started", TOMBO_PREFIX=str(box.folder / "nowhere"))
    assert run.returncode != 0 and "started" not in run.stdout


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
