"""The Dockerfile: hadolint finds nothing, and it copies, runs and starts what there is."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCKERFILE = ROOT / "docker" / "Dockerfile"
PACKAGES = sorted(path.parent.name for path in ROOT.glob("tombo_ws/src/*/package.xml"))


def instructions(text: str) -> Iterator[tuple[str, str]]:
    """(instruction, rest) of a Dockerfile, continued lines joined, comments left out."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    for line in "\n".join(lines).replace("\\\n", " ").splitlines():
        if line.strip():
            word, _, rest = line.strip().partition(" ")
            yield word, " ".join(rest.split())


ALL = list(instructions(DOCKERFILE.read_text()))


def stages() -> dict[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = {}
    for word, rest in ALL:
        if word == "FROM":
            found[rest.split(" AS ")[1]] = []
        list(found.values())[-1].append((word, rest))
    return found


def values(word: str) -> list[str]:
    return [rest for found, rest in ALL if found == word]


def test_hadolint_has_nothing_to_say():
    run = subprocess.run(
        [Path(sys.prefix) / "bin" / "hadolint", "--failure-threshold", "warning", DOCKERFILE],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout + run.stderr


def copied() -> list[str]:
    plain = [rest for rest in values("COPY") if not rest.startswith("--from")]
    return [source for rest in plain for source in rest.split()[:-1]]


@pytest.mark.parametrize("source", copied())
def test_what_is_copied_is_there_and_not_ignored(source: str):
    assert (ROOT / source).exists()
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    assert lines[1] == "*", "all is ignored but what follows"
    kept = [line[1:] for line in lines if line.startswith("!")]
    parts = [p.as_posix() for p in [Path(source), *Path(source).parents]]
    assert any(part in kept for part in parts)
    dropped = [line.removeprefix("**/") for line in lines if line.startswith("**/")]
    assert not any(fnmatch(Path(source).name, pattern) for pattern in dropped)


def test_what_runs_is_not_root_and_has_tried_its_nodes():
    for name in ("run", "foxglove"):
        assert [rest for word, rest in stages()[name] if word == "USER"][-1] == "tombo"
    steps = stages()["run"]
    assert steps.index(("RUN", "scripts/smoke.sh")) > steps.index(("USER", "tombo"))


def test_what_the_image_starts_is_there():
    (entry,) = values("ENTRYPOINT")
    (health,) = values("HEALTHCHECK")
    for words in (entry, health.partition("CMD ")[2]):
        (path,) = json.loads(words)
        assert (ROOT / "docker" / path.removeprefix("/opt/tombo/")).is_file()
    assert values("WORKDIR") == ["/opt/tombo"]
    command = json.loads(next(rest for word, rest in stages()["run"] if word == "CMD"))
    assert command[:3] == ["ros2", "launch", "tombo_bringup"]
    assert (ROOT / "tombo_ws/src/tombo_bringup/launch" / command[3]).is_file()
