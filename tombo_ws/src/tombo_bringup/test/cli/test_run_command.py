"""`tombo run`: finds the node, becomes it, and says what there is when it can't."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

NODE = """#!/nowhere/python
import sys
print(sys.argv[1:], flush=True)
sys.exit(3)
"""


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ROS prefix with one package: a node in Python, one that isn't, a file that is none."""
    place = tmp_path / "a prefix"
    (place / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (place / "share/ament_index/resource_index/packages/lab").touch()
    folder = place / "lib" / "lab"
    folder.mkdir(parents=True)
    (folder / "camera_node").write_text(NODE)
    (folder / "other_node").write_text("#!/bin/sh\necho other $1\n")
    (folder / "notes.txt").write_text("nothing to run")
    for name in ("camera_node", "other_node"):
        (folder / name).chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{place}")
    return place


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tombo_bringup.cli.main", "run", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_arguments_and_exit_code_are_the_nodes(prefix):
    words = ["--ros-args", "-p", "a.b:=1.0", "-r", "__node:=x", "--help", "--seed", "3"]
    process = start("lab", "camera_node", *words)
    out, err = process.communicate(timeout=60)

    assert out == f"{words}\n"
    assert (process.returncode, err) == (3, "")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("labb", "camera_node"), "unknown package 'labb' (did you mean 'lab'?)"),
        (("lab", "camera"), "(did you mean 'camera_node'?); accepted: camera_node, other_node"),
        (("lab", "notes.txt"), "unknown node in lab 'notes.txt'"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_one_line_with_what_is(refused, prefix, arguments, complaint):
    refused(("run", *arguments), complaint)
