"""`tombo run`: start one node, as `ros2 run` does where it is installed."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
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
    from ament_index_python import get_packages_with_prefixes

    from tombo_dynamics.errors import unknown_name

    prefixes = (os.environ.get("AMENT_PREFIX_PATH", ""), sys.prefix)  # the suite's is the last
    os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(filter(None, prefixes))
    prefixed = get_packages_with_prefixes().items()
    folders = {name: Path(prefix) / "lib" / name for name, prefix in prefixed}
    packages = {name: folder for name, folder in folders.items() if folder.is_dir()}
    if package not in packages:
        raise unknown_name("package", package, packages)
    files = sorted(packages[package].iterdir())
    nodes = {path.name: path for path in files if path.is_file() and os.access(path, os.X_OK)}
    if node not in nodes:
        raise unknown_name(f"node in {package}", node, nodes)
    return nodes[node]


def _is_python(path: Path) -> bool:
    with path.open("rb") as file:
        first = file.readline(256)
    return first.startswith(b"#!") and b"python" in first
