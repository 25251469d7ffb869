"""`make site`: every page is there, no link is dead, and it works without a network."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (ROOT / ".venv-site" / "requirements-site.txt").exists(),
        reason="no .venv-site here; `make site` makes it",
    ),
]


@pytest.fixture(scope="module")
def site() -> Path:
    """Return the folder of the site of this version, built with a warning as an error."""
    done = subprocess.run(["scripts/site.sh"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first = (ROOT / "build" / "site" / "index.html").read_text(encoding="utf-8")
    (version,) = re.findall(r"url=([^/]+)/index.html", first)
    return ROOT / "build" / "site" / version


def test_every_page_is_there(site):
    for page in (ROOT / "docs").glob("*.md"):
        assert (site / "docs" / f"{page.stem}.html").exists(), page


def test_commands_parameters_and_python_are_described(site):
    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    assert "tombo propeller recovery" in commands and "--disturbances" in commands
    assert "blind_timeout" in (site / "reference" / "parameters.html").read_text("utf-8")
    api = (site / "reference" / "python_api.html").read_text(encoding="utf-8")
    assert 'id="tombo.fly"' in api and 'id="tombo_dynamics.core.Core.step"' in api


def test_nothing_is_loaded_from_elsewhere(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert re.findall(r'<(?:script|img|iframe)[^>]+src="https?:', text) == []
        assert re.findall(r'<link[^>]+rel="(?:stylesheet|preload)"[^>]+href="https?:', text) == []
