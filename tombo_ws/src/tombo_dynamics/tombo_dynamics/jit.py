"""Compile a function once per version of the sources, and keep the machine code on disk.

Numba's own cache looks at the file that holds a function only, so machine code would go stale
when a function that it calls, in another file, changes. Here the cache folder's name is a hash of
every source file that compiled code can come from: a change anywhere means a new folder.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import config

_Function = TypeVar("_Function", bound=Callable[..., Any])
_PACKAGES = ("tombo_dynamics", "tombo_control", "tombo_collision", "tombo_sim")
_KEPT_VERSIONS = 4


def _source_hash() -> str:
    digest = hashlib.sha256(f"{sys.version}{numba.__version__}".encode())
    for package in _PACKAGES:
        spec = importlib.util.find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            continue
        for folder in spec.submodule_search_locations:
            for path in sorted(Path(folder).rglob("*.py")):
                if path.stem.endswith("_node"):
                    continue  # nothing compiled in there
                digest.update(path.relative_to(folder).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _root() -> Path:
    """Where compiled code is kept: $TOMBO_CACHE_DIR, the virtual environment, or ~/.cache."""
    candidates = []
    if os.environ.get("TOMBO_CACHE_DIR"):
        candidates.append(Path(os.environ["TOMBO_CACHE_DIR"]))
    if sys.prefix != sys.base_prefix:
        candidates.append(Path(sys.prefix) / "var" / "tombo_cache")
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    candidates.append(Path(base) / "tombo")
    for folder in candidates:
        if _writable(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="tombo_cache_"))


def _open_cache() -> Path:
    root = _root()
    folder = root / _source_hash()
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        versions = sorted(
            (p for p in root.iterdir() if p.is_dir()), key=lambda p: p.stat().st_mtime
        )
        for old in versions[:-_KEPT_VERSIONS]:
            shutil.rmtree(old, ignore_errors=True)
    return folder


CACHE_FOLDER: Path = _open_cache()


def compiled(function: _Function) -> _Function:
    """Compile `function` with numba (no GIL), cached on disk, always inlined.

    Arithmetic is strictly IEEE 754, in the order in which it is written: a function gives the same
    bits wherever it is inlined, in a node as in the headless flight. Division by zero gives inf or
    NaN as in C.
    """
    return _compile(function, inline=True)


def compiled_call(function: _Function) -> _Function:
    """Compile as `compiled` does, but for a call: for what does not run in every tick.

    Inlining costs compile time, and saves what passing arrays costs: a few nanoseconds a call.
    """
    return _compile(function, inline=False)


def _compile(function: _Function, inline: bool) -> _Function:
    previous = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE_FOLDER)
    try:
        decorated: Any = numba.njit(
            cache=True, nogil=True, forceinline=inline, error_model="numpy"
        )(function)
    finally:
        config.CACHE_DIR = previous
    return decorated  # type: ignore[no-any-return]
