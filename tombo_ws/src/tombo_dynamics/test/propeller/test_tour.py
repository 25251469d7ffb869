import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[5]


def test_the_tour_runs_and_draws(tmp_path: Path) -> None:
    picture = tmp_path / "tour.png"
    command = [sys.executable, str(ROOT / "examples" / "propeller_tour.py"), str(picture)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "12 mm, hover: 4674 rpm" in run.stdout
    assert "thrust 0.613 N" in run.stdout
