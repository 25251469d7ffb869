"""Permitted imports: the rules that keep the maths pure and the graph of packages a tree.

- A pure file reaches no ROS: `rclpy`, generated messages and `tombo_ros` belong to `*_node.py`
  files and to the package tombo_ros. `pymavlink` belongs to tombo_px4, compiled
  code to the packages of the compile cache.
- A package imports only what `MAY_IMPORT` lists for it, and nobody's node.
- Names with `ned` or `frd` as a part live in tombo_px4 and where PX4's logs are read: everywhere
  else the world is ENU and the body FLU.
- The pure packages know no clock and no unseeded randomness (ruff refuses numpy's own).
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SRC = Path(__file__).parents[2] / "tombo_ws" / "src"

MATHS = {"tombo_dynamics", "tombo_control", "tombo_collision"}
FLIGHT_CORE = {*MATHS, "tombo_bag", "tombo_sim", "tombo_px4"}
STUDIES = {"tombo_flight", "tombo_logs", "tombo_diagnosis"}
MAY_IMPORT = {
    "tombo_dynamics": set(),
    "tombo_control": {"tombo_dynamics"},
    "tombo_collision": {"tombo_dynamics"},
    "tombo_bag": {"tombo_dynamics"},
    # The fused kernel runs the physics and all cores in one compiled loop.
    "tombo_sim": MATHS,
    "tombo_ros": {"tombo_dynamics", "tombo_bag"},
    "tombo_mocap": {"tombo_dynamics", "tombo_bag"},
    "tombo_px4": {"tombo_dynamics", "tombo_control", "tombo_bag", "tombo_sim"},
    "tombo_flight": FLIGHT_CORE,
    # The functions that simulate an effect are the ones that the diagnosis fits.
    "tombo_logs": {"tombo_dynamics", "tombo_bag", "tombo_px4", "tombo_flight"},
    "tombo_diagnosis": {"tombo_dynamics", "tombo_bag", "tombo_sim", "tombo_flight", "tombo_logs"},
    "tombo_propeller": {"tombo_dynamics", "tombo_bag", "tombo_control", "tombo_sim", *STUDIES},
    "tombo": {*FLIGHT_CORE, *STUDIES},
    "tombo_web": {"tombo_dynamics", "tombo_bag", "tombo_flight", "tombo_propeller"},
    "tombo_bringup": {*FLIGHT_CORE, *STUDIES, "tombo_mocap", "tombo_propeller", "tombo_web"},
    "tombo_benchmarks": {*FLIGHT_CORE, *STUDIES, "tombo_propeller", "tombo_bringup"},
}
LIBRARIES = {
    "tombo_dynamics": {"numpy", "scipy", "numba", "yaml"},  # yaml: the paper's printed tables
    "tombo_control": {"numpy", "scipy", "numba"},
    "tombo_collision": {"numpy", "scipy", "numba", "filterpy", "daqp"},
    "tombo_sim": {"numpy", "scipy", "numba"},
    "tombo_logs": {"numpy", "scipy", "yaml", "pandas", "pyulog"},
    "tombo_diagnosis": {"numpy", "scipy", "yaml", "pandas", "filterpy"},
}
COMPILED = {*MATHS, "tombo_sim"}
"""Packages whose sources are in the key of the compile cache."""
COMPILED_ALONE = {
    ("tombo_benchmarks", "faults", "fault_model.py"),
    ("tombo_benchmarks", "speed", "kernel_flight.py"),
}
"""Call compiled code of these packages and of their file only, which the cache looks at, too."""
NED_FRD = {("tombo_px4",), ("tombo_logs", "readers", "ulog.py")}
"""Where names of PX4's frames may be: everywhere else the world is ENU and the body FLU."""
CLOCKLESS = {*LIBRARIES, "tombo_px4"}
SHELLS = {("tombo_diagnosis", "report")}
"""Folders of pure packages without maths: they start processes, draw and write files."""
DYNAMIC = {"import_module", "__import__"}
JIT = "tombo_dynamics.jit.compiled"
ROS = re.compile(r"rclpy|tombo_ros|\w+_msgs|\w+_interfaces|rosidl_\w+|rosgraph_\w+")


def is_node(path: Path) -> bool:
    return path.stem.endswith("_node")


def imported_modules(tree: ast.AST, package: str, path: Path) -> Iterator[tuple[int, str]]:
    """(line, absolute dotted name) of every import in the file, `from a import b` as `a.b`."""
    here = [package, *path.parent.parts]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = here[: len(here) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            for alias in node.names:
                yield node.lineno, f"{module}.{alias.name}"
        elif isinstance(node, ast.Call) and dotted(node.func).split(".")[-1] in DYNAMIC:
            yield from ((node.lineno, a.value) for a in node.args[:1] if is_text(a))


def is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def dotted(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


def identifiers(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        for field in ("id", "attr", "arg", "name", "asname"):
            name = getattr(node, field, None)
            if isinstance(name, str):
                yield getattr(node, "lineno", 0), name


def violations(package: str, path: Path, source: str) -> list[str]:
    """What breaks the rules in a file; `path` is relative to the package's import folder."""
    tree = ast.parse(source)
    found: list[str] = []

    def complain(line: int, text: str) -> None:
        found.append(f"{package}/{path}:{line}: {text}")

    here = (package, *path.parts)
    within = {here[:n] for n in range(1, len(here) + 1)}
    ros = is_node(path) or package == "tombo_ros"
    shell = ros or bool(SHELLS & within)

    for line, module in imported_modules(tree, package, path):
        parts = module.split(".")
        root = parts[0]
        if ROS.fullmatch(root) and root != package and not ros:
            complain(line, f"imports {root}: ROS belongs to *_node.py files and to tombo_ros")
        elif root in MAY_IMPORT and root != package and root != "tombo_ros":
            allowed = MAY_IMPORT[package] | (MAY_IMPORT["tombo_ros"] if ros else set())
            if root not in allowed:
                complain(line, f"imports {root}: {package} may not")
        elif root == "pymavlink":
            if package != "tombo_px4":
                complain(line, "imports pymavlink: that belongs to tombo_px4")
        elif package in LIBRARIES and not shell:
            known = {package, *LIBRARIES[package], *sys.stdlib_module_names}
            if root not in known and not root.startswith("tombo_") and not ROS.fullmatch(root):
                complain(line, f"imports {root}: {package} may use {sorted(LIBRARIES[package])}")
        outside = package not in COMPILED and here not in COMPILED_ALONE
        if outside and (root == "numba" or module.startswith(JIT)):
            complain(line, f"imports {module}: {package} is no part of the compile cache's key")
        nodes = [part for part in parts if part.endswith("_node")]
        if root in MAY_IMPORT and nodes and not is_node(path):  # a node may be made from another
            complain(line, f"imports the node {nodes[0]}: nodes are started, never imported")
        if package in CLOCKLESS and not shell and root in {"time", "datetime", "random"}:
            complain(line, f"imports {root}: time is an argument, randomness a Generator")

    if package in CLOCKLESS and not shell:
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and re.fullmatch(
                r"(.*\.)?default_rng\(\)", ast.unparse(node)
            ):
                complain(node.lineno, "default_rng() without a seed")

    if not NED_FRD & within:
        for line, name in [*identifiers(tree), (1, path.stem)]:
            if {"ned", "frd"} & set(name.lower().split("_")):
                complain(line, f"the name {name}: NED and FRD live in tombo_px4")
    return found


def files_of(package: str) -> list[Path]:
    return sorted((SRC / package / package).rglob("*.py"))


def python_packages() -> list[str]:
    return sorted(p.parent.name for p in SRC.glob("*/setup.py"))


@pytest.mark.slow
@pytest.mark.parametrize("package", python_packages())
def test_package_keeps_the_import_rules(package: str):
    assert package in MAY_IMPORT, f"say in MAY_IMPORT what {package} may import"
    files = files_of(package)
    assert files
    root = SRC / package / package
    found = [
        text
        for path in files
        for text in violations(package, path.relative_to(root), path.read_text())
    ]
    assert not found, "\n".join(["import rules broken:", *found])
