"""Metadata of a run: version with commit, and the complete scenario."""

from __future__ import annotations

import json
import subprocess

import pytest

from tombo_flight.version import commit_of


def git(folder, *arguments):
    who = ("-c", "user.name=n", "-c", "user.email=n@example.org")
    run = subprocess.run(
        ["git", *who, "-C", str(folder), *arguments], check=True, capture_output=True, text=True
    )
    return run.stdout.strip()


def test_a_version_names_the_commit_and_says_what_has_changed(tmp_path):
    source = tmp_path / "a.py"
    source.write_text("x = 1\n")
    git(tmp_path, "init", "-q")
    assert commit_of(source) == ""  # in a repository, but none of its files
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "one")
    assert commit_of(source) == git(tmp_path, "rev-parse", "--short=12", "HEAD")
    source.write_text("x = 2\n")
    assert commit_of(source) == git(tmp_path, "rev-parse", "--short=12", "HEAD") + ".dirty"


def test_a_source_file_outside_of_the_commit_makes_the_tree_dirty(tmp_path):
    folder = tmp_path / "tombo_ws" / "src" / "package"
    folder.mkdir(parents=True)
    (folder / "a.py").write_text("x = 1\n")
    (tmp_path / ".gitignore").write_text("/runs/\n*.pyc\n")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "one")
    clean = git(tmp_path, "rev-parse", "--short=12", "HEAD")
    (tmp_path / "runs").mkdir()
    for ignored in ("runs/mine.py", "notes.txt", "tombo_ws/src/package/a.pyc"):
        (tmp_path / ignored).write_text("")
        assert commit_of(folder / "a.py") == clean
    for source in ("tombo_ws/src/package/b.py", "tombo_ws/src/other.yaml", "mine.py"):
        (tmp_path / source).write_text("")
        assert commit_of(folder / "a.py") == f"{clean}.dirty"
        (tmp_path / source).unlink()


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        ("paper_collision", "--seed", "3", "--set", "propeller.conf=9", "--set", "duration=25"),
        ("vehicle", "--set", "effects.steady_wind.east=2", "--set", "duration=3", "--seed", "1"),
    ],
)
def test_the_scenario_of_a_run_flies_the_same_flight(tombo, tmp_path, options):
    name, *rest = options
    if name == "vehicle":
        name, rest = "hover", [*rest, "--vehicle", "px4_x500"]
    first = tombo("fly", name, *rest, "-o", "first", "--json").json
    seed = str(first["seed"])

    again = tombo("fly", "first/scenario.yaml", "--seed", seed, "-o", "again", "--json")

    assert again.code == 0, again.err
    bags = [(tmp_path / folder / "flight.mcap").read_bytes() for folder in ("first", "again")]
    assert bags[0] == bags[1]
    assert json.loads((tmp_path / "first" / "summary.json").read_text())["seed"] == int(seed)
