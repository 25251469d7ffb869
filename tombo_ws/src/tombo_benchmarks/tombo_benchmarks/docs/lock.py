"""`docs/figures.lock`: of each product of `make docs`, what was written and from which code.

A product is out of date when the code it depends on has changed (comments and docstrings do not
count), when the reference flights come out otherwise, or when its files were edited by hand.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from tombo_benchmarks.docs.markdown import marked
from tombo_dynamics.yaml_text import read_yaml

REFERENCE_FLIGHTS: dict[str, tuple[str, int, tuple[str, ...]]] = {
    "paper_collision, seed 0": ("paper_collision", 0, ()),
    "paper_collision, seed 1": ("paper_collision", 1, ()),
    "paper_collision, seed 0, rigid": ("paper_collision", 0, ("propeller.conf=0",)),
    "aggressive, seed 0": ("aggressive", 0, ()),
}
"""Flights that stand for all: name → scenario, seed, settings."""
_METRICS = (
    *("collision_time_s", "detection_latency_s", "max_falling_distance_m", "unstable_phase_s"),
    *("recovery_time_s", "max_tilt_rad", "hover_rms_m", "approach_rms_m", "duration_s"),
)
_HEAD = "# Written by `make docs`; a test says when a product is out of date. Do not edit.\n"


def read_lock(root: Path) -> dict[str, Any]:
    """Return the content of the lock file; empty if there is none."""
    path = root / "docs" / "figures.lock"
    return dict(read_yaml(path, str(path))) if path.is_file() else {}


def write_lock(root: Path, content: Mapping[str, Any]) -> None:
    """Write the lock file."""
    text = yaml.safe_dump(dict(content), sort_keys=True, width=98)
    (root / "docs" / "figures.lock").write_text(_HEAD + text, encoding="utf-8")


def reference_flights() -> dict[str, dict[str, float | None]]:
    """Fly the reference flights; return some metrics of each, rounded to 1e-3."""
    from tombo_flight.flight import fly_scenario
    from tombo_flight.scenario import load_scenario

    found = {}
    for name, (scenario, seed, settings) in REFERENCE_FLIGHTS.items():
        summary = fly_scenario(load_scenario(scenario, settings), seed).summary
        values = {key: summary[key] for key in _METRICS}
        found[name] = {k: None if v is None else round(float(v), 3) for k, v in values.items()}
    return found


def code_hash(root: Path, folders: Iterable[str]) -> str:
    """Return a hash of the Python code in some folders of `tombo_ws/src`, without its words."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((root / "tombo_ws" / "src" / folder).rglob("*.py")):
            digest.update("\n".join(_code_lines(path.read_text(encoding="utf-8"))).encode())
    return digest.hexdigest()[:16]


def content_hash(root: Path, place: str) -> str:
    """Return a hash of a file, or of `FILE#NAME`, what stands between a page's markers."""
    path, _, name = place.partition("#")
    if not (root / path).is_file():
        return "missing"
    data = (root / path).read_bytes()
    if name:
        data = marked(data.decode("utf-8"), name).encode()
    return hashlib.sha256(data).hexdigest()[:16]


def _code_lines(text: str) -> list[str]:
    """Return the lines of a source without docstrings, comment lines and blank lines."""
    left_out: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", [])
        for statement in body if isinstance(body, list) else []:
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                left_out.update(range(statement.lineno, (statement.end_lineno or 0) + 1))
    lines = enumerate(text.splitlines(), 1)
    kept = [line for i, line in lines if i not in left_out]
    return [line for line in kept if line.strip() and not line.lstrip().startswith("#")]
