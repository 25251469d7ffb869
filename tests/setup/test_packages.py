"""Every package is one that a standard ROS 2 Jazzy install builds and installs whole."""

from __future__ import annotations

import ast
import re
import sys
import xml.etree.ElementTree as ET
from configparser import ConfigParser
from pathlib import Path

import pytest

from tombo_bag.topics import TOPICS
from tombo_benchmarks.docs.tables import every_node, read_nodes

ROOT = Path(__file__).parents[2]
SRC = ROOT / "tombo_ws" / "src"
PACKAGES = sorted(path.parent for path in SRC.glob("*/package.xml"))
PYTHON_PACKAGES = [package for package in PACKAGES if (package / "setup.py").exists()]
SHARE = ("config", "foxglove", "launch", "rviz")
"""Folders without code that are installed under share/."""
IGNORED = {"__pycache__", ".pyc", ".nbi", ".nbc"}

# Import name -> rosdep key, where the key is not the import name itself. rosdep has none for mcap,
# lz4 and zstandard: mcap-ros2-support, which needs them, brings them. All are in
# rosdep/python.yaml of github.com/ros/rosdistro.
ROSDEP_KEY = {
    "PIL": "python3-pil",
    "filterpy": "python3-filterpy-pip",
    "jinja2": "python3-jinja2",
    "lz4": "mcap-ros2-support",
    "markupsafe": "python3-jinja2",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "mpl_toolkits": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pandas": "python3-pandas",
    "pymavlink": "python3-pymavlink-pip",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "typer": "python3-typer",
    "yaml": "python3-yaml",
    "zstandard": "mcap-ros2-support",
}
TEST_KEYS = {"python3-hypothesis", "python3-pytest"}
WITHOUT_KEY = {
    *("daqp", "distributed", "foxglove", "gymnasium", "motioncapture", "pyarrow", "pyulog"),
    *("starlette", "uvicorn", "websockets"),
}
"""Imports for which rosdep has no key: from pip, which docs/nodes.md says."""


def manifest(package: Path) -> ET.Element:
    return ET.parse(package / "package.xml").getroot()


def setup_cfg(package: Path) -> ConfigParser:
    found = ConfigParser()
    found.read(package / "setup.cfg")
    return found


def by_name(package: Path) -> str:
    return package.name


def test_all_packages_carry_the_version_of_the_changelog():
    versions = {package.name: manifest(package).findtext("version") for package in PACKAGES}
    for package in PYTHON_PACKAGES:
        versions[f"{package.name}/setup.cfg"] = setup_cfg(package)["metadata"]["version"]
    newest = re.search(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest is not None
    assert set(versions.values()) == {newest[1]}, versions


@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=by_name)
def test_python_package_is_laid_out_for_ament(package: Path):
    name, found = package.name, setup_cfg(package)
    assert manifest(package).findtext("name") == found["metadata"]["name"] == name
    assert found["options.packages.find"]["include"].split() == [name, f"{name}.*"]
    assert found["develop"]["script_dir"] == f"$base/lib/{name}"
    assert found["install"]["install_scripts"] == f"$base/lib/{name}"
    assert found["options.extras_require"]["test"] == "pytest"  # colcon test runs nothing without
    data = found["options.data_files"]
    assert data["share/ament_index/resource_index/packages"] == f"resource/{name}"
    assert data[f"share/{name}"] == "package.xml"


@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=by_name)
def test_all_that_is_there_is_installed_and_nothing_else(package: Path):
    """Folders of code are packages; every other file matches a pattern, every pattern a file."""
    name, found = package.name, setup_cfg(package)
    files = {p for p in package.rglob("*") if p.is_file() and not IGNORED & {*p.parts, p.suffix}}
    code = {p for p in files if p.suffix == ".py" and package / name in p.parents}
    assert [f for f in {p.parent for p in code} if not (f / "__init__.py").exists()] == []
    patterns = [p for value in found["options.data_files"].values() for p in value.split()]
    patterns += [f"{name}/{p}" for p in found["options.package_data"][name].split()]
    assert [p for p in patterns if not any(package.glob(p))] == []
    installed = {path for pattern in patterns for path in package.glob(pattern)}
    data = {p for p in files if p.relative_to(package).parts[0] in (name, *SHARE)}
    assert data - code - installed == set()


@pytest.mark.slow
@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=by_name)
def test_every_import_is_declared_in_package_xml(package: Path):
    declared = {
        element.text
        for tag in ("depend", "exec_depend")
        for element in manifest(package).findall(tag)
    }
    imported: set[str] = set()
    for path in [*(package / package.name).rglob("*.py"), *package.glob("launch/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                imported.add(node.module.split(".")[0])
    needed = {
        ROSDEP_KEY.get(name, name)
        for name in imported - set(sys.stdlib_module_names) - {package.name} - WITHOUT_KEY
    }
    assert needed <= declared, f"add to {package.name}/package.xml: {sorted(needed - declared)}"


@pytest.mark.parametrize("package", PACKAGES, ids=by_name)
def test_no_manifest_has_a_key_that_rosdep_does_not_have(package: Path):
    keys = {element.text or "" for element in manifest(package) if "depend" in element.tag}
    libraries = {key for key in keys if "-" in key}  # ROS packages are written with _
    assert libraries <= {*ROSDEP_KEY.values(), *TEST_KEYS}


def test_libraries_without_a_key_are_pinned_and_documented():
    files = ("requirements.txt", "requirements-study.txt", "requirements-web.txt")
    pinned = "".join(f"\n{(ROOT / name).read_text()}" for name in files)
    page = (ROOT / "docs" / "nodes.md").read_text()
    for name in WITHOUT_KEY:
        assert f"\n{name}==" in pinned or f"\n{name}-sdk==" in pinned
        assert f"`{name}`" in page


def test_the_messages_of_every_node_are_declared():
    more = {name: f"tombo_px4.{name}" for name in ("px4_sim_node", "hil_sim_node")}
    nodes = [*every_node(), *read_nodes(more)]
    used = {node.package: set(TOPICS) for node in nodes if node.name == "recorder"}
    for node in nodes:
        used.setdefault(node.package, set()).update(node.publishes, node.subscribes)
    for name, names in used.items():
        types = {TOPICS[topic].typename.partition("/")[0] for topic in names}
        declared = {element.text for element in manifest(SRC / name).findall("exec_depend")}
        assert types <= declared, f"add to {name}/package.xml: {sorted(types - declared)}"


def test_requirements_are_pinned_once_each():
    """That each has a hash, pip demands."""
    files = [p for p in ROOT.glob("requirements*.txt") if p.name != "requirements-site.txt"]
    lines = [line for path in files for line in re.findall(r"^[^#\n].*", path.read_text(), re.M)]
    assert [line for line in lines if not re.match(r"[\w.-]+==[\w.]+ ", line)] == []
    names = [re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower() for line in lines]
    assert sorted(set(names)) == sorted(names)
