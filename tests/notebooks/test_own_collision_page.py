"""The tutorial of docs/own_collision.md works as it is written."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "own_collision.md"


@pytest.mark.slow
def test_the_files_of_the_page_fly_with_its_commands(tmp_path):
    text = PAGE.read_text(encoding="utf-8")
    for name, block in re.findall(r"Save as `([\w.]+)`:\n\n```\w+\n(.*?)```", text, re.S):
        (tmp_path / name).write_text(block, encoding="utf-8")
    (commands,) = re.findall(r"```sh\n(.*?)```", text, re.S)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", commands],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    post, up = (
        json.loads((tmp_path / "runs" / name / "summary.json").read_text())
        for name in ("post", "up")
    )
    assert post["collided"] and up["reaction"] == "back_and_up"
    assert up["x_r_m"][2] - up["x_c_m"][2] == pytest.approx(0.4, abs=0.01)
