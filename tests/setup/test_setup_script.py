"""scripts/setup.sh: says in one line what is missing, does a step only when needed, recovers.

The interpreter, pip and colcon are stand-ins that note how they were called, so that a test takes
a fraction of a second.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
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


def without(tool: str) -> Callable[[Clone], None]:
    return lambda clone: (clone.bin / tool).unlink()


def lacking(part: str) -> Callable[[Clone], None]:
    return lambda clone: (clone.root / part).touch()


def of_version(version: str) -> Callable[[Clone], object]:
    return lambda clone: (clone.root / "version").write_text(version)


OLD_CMAKE = "#!/bin/bash\necho cmake version 3.16.3\n"


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        (without("g++"), ["Debian package g++"]),
        (without("python3"), ["Debian package python3"]),
        (lacking("no_venv"), ["install the Debian package python3-venv"]),
        (lacking("no_headers"), ["install the Debian package python3-dev"]),
        (lambda clone: clone.write_tool("cmake", OLD_CMAKE), ["3.16.3", "3.21", "package cmake"]),
        (of_version("3.10"), ["3.11 to 3.13"]),
        (of_version("3.14"), ["3.11 to 3.13"]),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_what_is_missing_is_one_line(
    clone: Clone, fault: Callable[[Clone], None], named: list[str]
) -> None:
    fault(clone)
    run = clone.setup()
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.count("\n") == 1 and run.stderr.startswith("set-up: ")
    assert all(words in run.stderr for words in named)
    assert not (clone.root / ".venv").exists(), "nothing is made before everything is there"


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


def test_a_second_run_says_and_does_nothing(clone: Clone):
    assert clone.setup().returncode == 0
    assert clone.steps() == ["venv", "pip", "colcon"]
    second = clone.setup()
    assert (second.returncode, second.stdout, second.stderr) == (0, "", "")
    assert clone.steps() == []


@pytest.mark.parametrize(
    ("edited", "steps"),
    [
        ("requirements.txt", ["pip", "colcon"]),
        ("tombo_ws/src/tombo_msgs/msg/Contact.msg", ["colcon"]),
        ("tombo_ws/src/tombo_msgs/package.xml", ["colcon"]),
        ("tombo_ws/src/tombo_sim/launch/sim.launch.py", ["colcon"]),
        ("tombo_ws/src/tombo_sim/tombo_sim/simulator.py", []),
    ],
)
def test_an_edit_redoes_only_what_depends_on_it(clone: Clone, edited: str, steps: list[str]):
    clone.setup()
    clone.steps()
    path = clone.root / edited
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        file.write("\n# edited\n")
    assert clone.setup().returncode == 0
    assert clone.steps() == steps


def test_a_half_done_update_of_the_requirements_is_not_trusted(clone: Clone):
    clone.setup()
    (clone.root / "no_network").touch()
    (clone.root / "requirements.txt").write_text("numpy==1.0\n")
    run = clone.setup()
    assert run.returncode == 1
    assert "cannot reach the index" in run.stderr and "setup-2.log" in run.stderr
    clone.steps()
    shutil.copy(ROOT / "requirements.txt", clone.root)  # as it was: yet .venv may be half changed
    (clone.root / "no_network").unlink()
    assert clone.setup().returncode == 0
    assert clone.steps() == ["venv", "pip", "colcon"]


def test_a_failed_build_keeps_the_requirements(clone: Clone):
    (clone.root / "bad_code").touch()
    assert clone.setup().returncode == 1
    (clone.root / "build/colcon/left_over").touch()
    clone.steps()
    (clone.root / "bad_code").unlink()
    assert clone.setup().returncode == 0
    assert clone.steps() == ["colcon"]
    assert not (clone.root / "build/colcon/left_over").exists()


def test_a_sourced_ros_does_not_leak_in(clone: Clone):
    seen = clone.root / "seen"
    clone.write_python(new=f'echo "$PYTHONPATH$AMENT_PREFIX_PATH" >> {seen}\n')
    clone.setup(PYTHONPATH="/opt/ros/python", AMENT_PREFIX_PATH="/opt/ros/jazzy")
    assert "/opt/ros" not in seen.read_text()
