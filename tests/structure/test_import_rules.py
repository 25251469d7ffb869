"""Who may import whom: the rules that keep the maths pure and the graph of packages a tree.

- A pure file reaches no ROS: `rclpy`, generated messages and `tombo_ros` belong to `*_node.py`
  files and to the package tombo_ros. `pymavlink` belongs to `px4/`, compiled code elsewhere;
  `cv2` to `tombo_sysid/spin/`.
- A package imports only what `MAY_IMPORT` lists for it, and nobody's node.
- Names with `ned` or `frd` as a part live under `px4/`: everywhere else the world is ENU and the
  body FLU.
- The pure packages know no clock and no unseeded randomness.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SRC = Path(__file__).parents[2] / "tombo_ws" / "src"

MAY_IMPORT = {
    "tombo_dynamics": set(),
    "tombo_control": {"tombo_dynamics"},
    "tombo_collision": {"tombo_dynamics"},
    "tombo_bag": {"tombo_dynamics"},
    # The fused kernel runs the physics and the cascade in one compiled loop.
    "tombo_sim": {"tombo_dynamics", "tombo_control"},
    "tombo_ros": {"tombo_dynamics", "tombo_bag"},
    # The functions that simulate an effect are the ones that the diagnosis fits.
    "tombo_sysid": {"tombo_dynamics", "tombo_bag", "tombo_sim"},
    "tombo_bringup": {
        "tombo_dynamics",
        "tombo_control",
        "tombo_collision",
        "tombo_bag",
        "tombo_sim",
        "tombo_sysid",
    },
}
LIBRARIES = {
    "tombo_dynamics": {"numpy", "scipy", "numba", "yaml"},  # yaml: the paper's printed tables
    "tombo_control": {"numpy", "scipy", "numba"},
    "tombo_collision": {"numpy", "scipy", "numba", "filterpy"},
    "tombo_sim": {"numpy", "scipy", "numba"},
    "tombo_sysid": {"numpy", "scipy", "yaml", "pyulog", "ruptures", "cv2"},
}
CLOCKLESS = set(LIBRARIES)
SEEDED = {"BitGenerator", "Generator", "PCG64", "Philox", "SeedSequence", "default_rng"}
DYNAMIC = {"import_module", "__import__"}
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

    shell = is_node(path) or package == "tombo_ros"
    px4 = "px4" in path.parts[:-1]

    for line, module in imported_modules(tree, package, path):
        parts = module.split(".")
        root = parts[0]
        if ROS.fullmatch(root) and root != package and not shell:
            complain(line, f"imports {root}: ROS belongs to *_node.py files and to tombo_ros")
        elif root in MAY_IMPORT and root != package and root != "tombo_ros":
            allowed = MAY_IMPORT[package] | (MAY_IMPORT["tombo_ros"] if shell else set())
            if root not in allowed:
                complain(line, f"imports {root}: {package} may not")
        elif root == "pymavlink":
            if not px4:
                complain(line, "imports pymavlink: that belongs to px4/")
        elif root == "cv2" and path.parts[:1] != ("spin",):
            complain(line, "imports cv2: that belongs to tombo_sysid/spin/")
        elif package in LIBRARIES and not shell and not px4:
            known = {package, *LIBRARIES[package], *sys.stdlib_module_names}
            if root not in known and not root.startswith("tombo_") and not ROS.fullmatch(root):
                complain(line, f"imports {root}: {package} may use {sorted(LIBRARIES[package])}")
        if px4 and (root == "numba" or module.startswith("tombo_dynamics.jit")):
            complain(line, f"imports {module}: what is under px4/ is no part of the cache's key")
        nodes = [part for part in parts if part.endswith("_node")]
        if root in MAY_IMPORT and nodes and not (root == package and is_node(path)):
            complain(line, f"imports the node {nodes[0]}: nodes are started, never imported")
        if package in CLOCKLESS and not shell:
            if root in {"time", "datetime", "random"}:
                complain(line, f"imports {root}: time is an argument, randomness a Generator")
            if module.startswith("numpy.random.") and parts[2] not in SEEDED:
                complain(line, f"imports {module}: randomness comes from a Generator")

    if package in CLOCKLESS and not shell:
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute):
                name = dotted(node)
                drawn = re.fullmatch(r"(np|numpy)\.random\.(\w+)", name)
                if drawn and drawn[2] not in SEEDED:
                    complain(node.lineno, f"{name}: randomness comes from a Generator")
            if isinstance(node, ast.Call) and re.fullmatch(
                r"(.*\.)?default_rng\(\)", ast.unparse(node)
            ):
                complain(node.lineno, "default_rng() without a seed")

    if not px4:
        for line, name in [*identifiers(tree), (1, path.stem)]:
            if {"ned", "frd"} & set(name.lower().split("_")):
                complain(line, f"the name {name}: NED and FRD live under px4/")
    return found


def files_of(package: str) -> list[Path]:
    return sorted((SRC / package / package).rglob("*.py"))


def python_packages() -> list[str]:
    return sorted(p.parent.name for p in SRC.glob("*/setup.py"))


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


def test_the_graph_of_packages_has_no_cycle():
    done: set[str] = set()
    while len(done) < len(MAY_IMPORT):
        ready = {p for p, needs in MAY_IMPORT.items() if p not in done and needs <= done}
        assert ready, f"these import each other: {sorted(set(MAY_IMPORT) - done)}"
        done |= ready


@pytest.mark.parametrize(
    ("package", "file", "source", "complaint"),
    [
        ("tombo_dynamics", "rotation.py", "import rclpy", "ROS belongs to"),
        ("tombo_dynamics", "rotation.py", "from rclpy.node import Node", "ROS belongs to"),
        ("tombo_sim", "a.py", "def f():\n    import rclpy", "ROS belongs to"),
        ("tombo_sim", "a.py", "import importlib\nimportlib.import_module('rclpy')", "ROS belongs"),
        ("tombo_bag", "sink.py", "from tombo_msgs.msg import Contact", "ROS belongs to"),
        ("tombo_bag", "sink.py", "from builtin_interfaces.msg import Time", "ROS belongs to"),
        ("tombo_bringup", "flight.py", "from tombo_ros import qos", "ROS belongs to"),
        ("tombo_dynamics", "params.py", "import tombo_control", "tombo_dynamics may not"),
        ("tombo_collision", "a.py", "from tombo_sim.x import y", "tombo_collision may not"),
        ("tombo_control", "rate_node.py", "import tombo_sim", "tombo_control may not"),
        ("tombo_dynamics", "params.py", "import pandas", "may use"),
        ("tombo_control", "a.py", "import pymavlink", "belongs to px4/"),
        ("tombo_sysid", "track.py", "import cv2", "belongs to tombo_sysid/spin/"),
        ("tombo_sysid", "spin/disc.py", "import cv2", ""),
        ("tombo_sim", "px4/a.py", "from tombo_dynamics.jit import compiled", "the cache's key"),
        ("tombo_control", "b_node.py", "from tombo_control import a_node, x\nimport rclpy", ""),
        ("tombo_control", "a.py", "from . import rate_node", "nodes are started"),
        ("tombo_control", "px4/a.py", "from ..rate_node import main", "nodes are started"),
        ("tombo_bringup", "a.py", "from tombo_sim.sim_node import main", "nodes are started"),
        ("tombo_control", "a.py", "position_ned = 1", "live under px4/"),
        ("tombo_control", "a.py", "def f(x_frd): ...", "live under px4/"),
        ("tombo_control", "ned_frames.py", "", "live under px4/"),
        ("tombo_control", "px4/frames.py", "def enu_from_ned(p_ned): ...", ""),
        ("tombo_control", "a.py", "planned = learned = 1", ""),
        ("tombo_sim", "a.py", "import time", "time is an argument"),
        ("tombo_sim", "sim_node.py", "import time\nimport rclpy", ""),
        ("tombo_bringup", "bench.py", "import time", ""),
        ("tombo_sim", "a.py", "import numpy as np\nnp.random.normal()", "from a Generator"),
        ("tombo_sim", "a.py", "from numpy.random import normal", "from a Generator"),
        ("tombo_sim", "a.py", "import numpy as np\nnp.random.default_rng()", "without a seed"),
        ("tombo_sim", "a.py", "import numpy as np\nr = np.random.default_rng(3)", ""),
        ("tombo_sim", "a.py", "from tombo_control.allocation import allocate", ""),
    ],
)
def test_the_rules_catch_what_they_should(package: str, file: str, source: str, complaint: str):
    found = "\n".join(violations(package, Path(file), source))
    assert complaint in found if complaint else not found


def test_importing_every_pure_module_loads_no_ros():
    modules = [
        ".".join(path.relative_to(SRC / package).with_suffix("").parts).removesuffix(".__init__")
        for package in python_packages()
        if package != "tombo_ros"
        for path in files_of(package)
        # launching.py is the launch files' own: it needs the `launch` of a ROS install.
        if not is_node(path) and path.stem not in {"__main__", "launching"}
    ]
    code = (
        "import importlib, sys\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "sys.exit(str({'rclpy', 'tombo_msgs', 'tombo_ros'} & set(sys.modules) or '') or None)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
