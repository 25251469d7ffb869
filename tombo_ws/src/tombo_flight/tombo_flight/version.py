"""The version of the suite with its commit, for `tombo --version` and summaries."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

_GIT = ("git", "--no-optional-locks")
_LONGEST_S = 5.0


_UNTRACKED = ("ls-files", "--others", "--exclude-standard", "--")
_SOURCES = (":/*.py", ":/tombo_ws/src")
"""Where a file of the repository is code, or a scenario or vehicle that is flown by name."""


@cache
def tombo_version() -> str:
    """Return the installed version and the commit of its source: "0.2.0+g07d9e2a1b2c3".

    ".dirty" follows where files differ from that commit, or a source file is not in it. Without
    git, or where the source is in no repository, the version alone; "unknown" when run from
    sources that are not installed.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        installed = version("tombo_bringup")
    except PackageNotFoundError:
        installed = "unknown"
    commit = commit_of(Path(__file__))
    return f"{installed}+g{commit}" if commit else installed


def commit_of(source: Path) -> str:
    """Return the commit that a source file is of, empty: of none.

    ".dirty" follows after changes, and where a source file is neither in the commit nor ignored.
    """
    folder = source.resolve().parent
    if not _git(folder, "ls-files", "--error-unmatch", source.name):
        return ""  # it is in no repository, or in another project's
    commit = _git(folder, "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=.dirty")
    if commit.endswith(".dirty") or not _git(folder, *_UNTRACKED, *_SOURCES):
        return commit
    return f"{commit}.dirty"


def _git(folder: Path, *arguments: str) -> str:
    """Return what git says; empty where it fails or is not there."""
    try:
        run = subprocess.run(
            [*_GIT, "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return run.stdout.strip() if run.returncode == 0 else ""
