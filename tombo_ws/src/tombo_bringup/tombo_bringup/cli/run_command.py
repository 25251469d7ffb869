"""`tombo run`: start one node, as `ros2 run` does where it is installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import typer

from tombo_bringup.cli.options import argument, command, record

app = typer.Typer()

PASS_ON = {
    "allow_extra_args": True,
    "ignore_unknown_options": True,
    "allow_interspersed_args": False,
}
"""Settings of the command: whatever comes after the node's name is the node's."""


@record
class _Node:
    package: str = argument("PACKAGE", "As tombo_collision.")
    node: str = argument("NODE", "As detector_node.")


@command(app, "run", hidden=True, context_settings=PASS_ON)
def run_executable(ctx: typer.Context, which: _Node) -> None:
    """Start one node, as `ros2 run` does where it is installed.

    Arguments after NODE are passed on, as --ros-args -p detector.threshold:=80.0; the exit code
    is the node's.
    """
    replace_process_by(which.package, which.node, ctx.args)


def replace_process_by(package: str, node: str, arguments: Sequence[str]) -> NoReturn:
    """Become a node, with arguments.

    Raises:
        InputError: as `find_executable`.
    """
    path = find_executable(package, node)
    sys.stdout.flush()
    command = [str(path), *arguments]
    if _is_python(path):  # not by its first line, which can't name a folder with a space
        command.insert(0, sys.executable)
    os.execv(command[0], command)


def find_executable(package: str, node: str) -> Path:
    """Return the executable of a node, installed under `lib/PACKAGE` of a ROS prefix.

    Raises:
        InputError: no such package, or no such node in it; with what there is.
    """
    from tombo_dynamics.errors import unknown_name

    packages: dict[str, dict[str, Path]] = {}
    for name, path in _executables():
        packages.setdefault(name, {}).setdefault(path.name, path)  # the first prefix wins
    if package not in packages:
        raise unknown_name("package", package, packages)
    if node not in packages[package]:
        raise unknown_name(f"node in {package}", node, packages[package])
    return packages[package][node]


def _executables() -> Iterator[tuple[str, Path]]:
    """Yield (package, path) of all that can be run: files in `lib/PACKAGE` of packages known."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in dict.fromkeys(Path(text) for text in prefixes if text):
        index = prefix / "share" / "ament_index" / "resource_index" / "packages"
        names = sorted(entry.name for entry in index.iterdir()) if index.is_dir() else []
        for name in names:
            folder = prefix / "lib" / name
            for path in sorted(folder.iterdir()) if folder.is_dir() else []:
                if path.is_file() and os.access(path, os.X_OK):
                    yield name, path


def _is_python(path: Path) -> bool:
    with path.open("rb") as file:
        first = file.readline(256)
    return first.startswith(b"#!") and b"python" in first
