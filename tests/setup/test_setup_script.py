"""scripts/setup.sh: says in one line what is missing, does a step only when needed, recovers.

The interpreter, pip and colcon are stand-ins that note how they were called, so that a test takes
a fraction of a second.
"""

from __future__ import annotations

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
TOOLS = """
    bash basename cat chmod cp cut dirname env find flock head ls ln mkdir mv rm sed sha256sum
    sleep sort tail uname xargs
""".split()  # noqa: SIM905 - a list would take a line for each

PYTHON = """#!/bin/bash
root={root}
echo "$*" >> $root/calls
case "$*" in
  *version_info*) cat $root/version ;;
  *ensurepip*) [ ! -e $root/no_venv ] ;;
  *Python.h*) [ ! -e $root/no_headers ] ;;
  *purelib*) echo $root/.venv/site ;;
  "-m venv "*) mkdir -p $3/bin $3/site && cp "$0" $3/bin/python ;;
  "-m pip "*) [ ! -e $root/no_network ] || {{ echo "cannot reach the index"; exit 1; }} ;;
  "-m colcon "*) mkdir -p $root/build/colcon; [ ! -e $root/bad_code ] ;;
esac
"""


@dataclass
class Clone:
    """A clone of the project with a PATH of its own."""

    root: Path
    bin: Path

    def setup(self, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.root / "scripts" / "setup.sh"],
            env={"PATH": str(self.bin), "HOME": str(self.root), **environment},
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=60,
        )

    def write_python(self, old: str = "", new: str = "", name: str = "python3") -> None:
        """Write the stand-in for an interpreter, `old` replaced by `new`."""
        text = PYTHON.format(root=self.root)
        assert old in text
        self.write_tool(name, text.replace(old, new) if old else text + new)

    def write_tool(self, name: str, text: str) -> None:
        path = self.bin / name
        path.unlink(missing_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def steps(self) -> list[str]:
        """The steps done since last asked: venv, pip, colcon."""
        calls = self.root / "calls"
        lines = calls.read_text().splitlines() if calls.exists() else []
        calls.unlink(missing_ok=True)
        steps = [line.split()[1] for line in lines if line.startswith("-m ")]
        return [step for step, _ in groupby(steps)]  # pip renews itself first


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    root, folder = tmp_path / "clone", tmp_path / "bin"
    folder.mkdir()
    (root / "scripts").mkdir(parents=True)
    shutil.copy(ROOT / "scripts" / "setup.sh", root / "scripts")
    for path in ROOT.glob("requirements*.txt"):
        shutil.copy(path, root)
    for name in ("tombo_msgs", "tombo_sim"):
        package = root / "tombo_ws" / "src" / name
        package.mkdir(parents=True)
        (package / "package.xml").write_text(f"<name>{name}</name>")
    (root / "tombo_ws/src/tombo_sim/setup.py").touch()
    (root / "tombo_ws/src/tombo_msgs/msg").mkdir()
    (root / "tombo_ws/src/tombo_msgs/msg/Contact.msg").write_text("bool in_contact")
    for tool in TOOLS:
        (folder / tool).symlink_to(shutil.which(tool) or f"/usr/bin/{tool}")
    made = Clone(root, folder)
    (root / "version").write_text("3.12\n")
    made.write_python()
    made.write_tool("cmake", "#!/bin/bash\necho cmake version 3.25.1\n")
    for tool in ("g++", "make"):
        made.write_tool(tool, "#!/bin/bash\n")
    return made


def missing_line(clone: Clone, **environment: str) -> str:
    run = clone.setup(**environment)
    assert run.returncode == 2, run
    assert run.stdout == ""
    assert run.stderr.count("\n") == 1 and run.stderr.startswith("set-up: "), run.stderr
    assert not (clone.root / ".venv").exists(), "nothing is made before everything is there"
    return run.stderr.strip()


@pytest.mark.parametrize(("tool", "package"), [("g++", "g++"), ("python3", "python3")])
def test_a_missing_tool_is_one_line_with_its_debian_package(clone: Clone, tool: str, package: str):
    (clone.bin / tool).unlink()
    assert f"Debian package {package}" in missing_line(clone)


@pytest.mark.parametrize(
    ("lacks", "package"), [("no_venv", "python3-venv"), ("no_headers", "python3-dev")]
)
def test_a_python_without_its_parts_is_one_line(clone: Clone, lacks: str, package: str):
    (clone.root / lacks).touch()
    assert missing_line(clone).endswith(f"install the Debian package {package}")


def test_an_old_cmake_is_named_with_its_version(clone: Clone):
    clone.write_tool("cmake", "#!/bin/bash\necho cmake version 3.16.3\n")
    line = missing_line(clone)
    assert "3.16.3" in line and "3.21" in line and "package cmake" in line


@pytest.mark.parametrize("version", ["3.10", "3.14"])
def test_a_python_out_of_range_is_refused(clone: Clone, version: str):
    (clone.root / "version").write_text(version)
    assert "3.11 to 3.13" in missing_line(clone)
    assert version in missing_line(clone, PYTHON="python3")


def test_a_foreign_venv_is_left_alone(clone: Clone):
    notes = clone.root / ".venv" / "notes"
    notes.parent.mkdir()
    notes.touch()
    run = clone.setup()
    assert run.returncode == 2 and "not made by this script" in run.stderr
    assert notes.exists() and clone.steps() == []


def test_a_set_up_waits_for_one_that_is_running(clone: Clone):
    clone.write_python("bin/python ;;", "bin/python; sleep 1 ;;")
    with ThreadPoolExecutor() as pool:
        runs = list(pool.map(lambda _: clone.setup(), range(2)))
    assert [run.returncode for run in runs] == [0, 0]
    assert clone.steps() == ["venv", "pip", "colcon"]


@pytest.mark.parametrize(
    ("edited", "steps"),
    [
        ("requirements.txt", ["pip", "colcon"]),
        ("tombo_ws/src/tombo_msgs/msg/Contact.msg", ["colcon"]),
        ("tombo_ws/src/tombo_msgs/package.xml", ["colcon"]),
        ("tombo_ws/src/tombo_sim/setup.py", ["colcon"]),
        ("tombo_ws/src/tombo_sim/launch/sim.launch.py", ["colcon"]),
        ("tombo_ws/src/tombo_sim/tombo_sim/simulator.py", []),
    ],
)
def test_an_edit_redoes_only_what_depends_on_it(clone: Clone, edited: str, steps: list[str]):
    clone.setup()
    clone.steps()
    path = clone.root / edited
    path.parent.mkdir(exist_ok=True)
    with path.open("a") as file:
        file.write("\n# edited\n")
    assert clone.setup().returncode == 0
    assert clone.steps() == steps


def test_a_moved_clone_makes_a_new_environment(clone: Clone, tmp_path: Path):
    clone.setup()
    moved = Clone(clone.root.rename(tmp_path / "moved"), clone.bin)
    moved.write_python()
    moved.steps()
    assert moved.setup().returncode == 0
    assert moved.steps() == ["venv", "pip", "colcon"]


def test_a_failed_install_shows_its_log_and_starts_afresh_next_time(clone: Clone):
    (clone.root / "no_network").touch()
    run = clone.setup()
    assert run.returncode == 1
    assert "cannot reach the index" in run.stderr and "setup-2.log" in run.stderr
    clone.steps()
    (clone.root / "no_network").unlink()
    assert clone.setup().returncode == 0
    assert clone.steps() == ["venv", "pip", "colcon"]


@pytest.mark.parametrize("bad", [False, True])
def test_kernels_are_compiled_while_the_workspace_is_built(clone: Clone, bad: bool):
    warmup = clone.root / "tombo_ws/src/tombo_bringup/tombo_bringup/warmup.py"
    warmup.parent.mkdir(parents=True)
    warmup.touch()
    warmed = f"[[ $(<{clone.root}/calls) == *warmup* ]]"
    waits = f"for i in {{1..100}}; do {warmed} && break; sleep 0.05; done; {warmed} || exit 1"
    clone.write_python("*) mkdir -p $root/build", f"*) {waits}; mkdir -p $root/build")
    python = clone.bin / "python3"
    warm = f'"-m tombo_bringup.warmup"*) {"echo no compiler; false" if bad else "true"} ;;\nesac'
    python.write_text(python.read_text().replace("esac", warm))

    run = clone.setup()

    steps = clone.steps()
    assert "colcon" in steps, "here it ends when the kernels have begun"
    assert steps[-1] == "tombo_bringup.warmup", "once more, to be seen"
    assert run.returncode == bad
    assert ("no compiler" in run.stderr) == bad


def test_a_sourced_ros_does_not_leak_in(clone: Clone):
    seen = clone.root / "seen"
    clone.write_python(new=f'echo "$PYTHONPATH$AMENT_PREFIX_PATH" >> {seen}\n')
    clone.setup(PYTHONPATH="/opt/ros/python", AMENT_PREFIX_PATH="/opt/ros/jazzy")
    assert "/opt/ros" not in seen.read_text()
