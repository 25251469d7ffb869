"""Reactions from files of the user: imported by path, here and in the processes that fly."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Iterable
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from tombo_collision.reactions import REGISTRY
from tombo_dynamics.errors import InputError, problem_in

_IMPORTED: dict[str, str] = {}
"""Absolute path → a hash of the content, of the files that are imported in this process."""


def imported_files() -> tuple[tuple[str, str], ...]:
    """Return absolute path and a hash of the content of each file that was imported."""
    return tuple(_IMPORTED.items())


def is_own(reaction: str) -> bool:
    """Return whether a reaction by name comes from an imported file."""
    module = sys.modules.get(REGISTRY[reaction].__module__)
    return str(getattr(module, "__file__", "")) in _IMPORTED


def import_reactions(paths: Iterable[str | Path]) -> None:
    """Import Python files, each with the reactions that it defines; one that is there stays.

    Raises:
        InputError: no such file, it fails, or it defines no reaction that can be flown.
    """
    for path in paths:
        _import(str(path))


class _Loader(SourceFileLoader):
    """Writes no compiled file into the user's folder."""

    def set_data(self, path: str, data: Any, *, _mode: int = 0o666) -> None:
        """Keep nothing."""


def _import(given: str) -> None:
    path, what = Path(given).resolve(), f"--import '{given}'"
    if str(path) in _IMPORTED:
        return
    if path.suffix != ".py" or not path.is_file():
        raise InputError(f"{what}: no such file; accepted: a Python file that defines a reaction")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    before = dict(REGISTRY)
    # A name of its own, the same in each process, so that objects can be sent between them.
    name = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path, loader=_Loader(name, str(path)))
    assert spec is not None and spec.loader is not None  # of every file that ends with .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # for what lies beside it
    try:
        spec.loader.exec_module(module)
        _check(module, what)
    except BaseException as error:
        del sys.modules[name]
        REGISTRY.clear()
        REGISTRY.update(before)
        if isinstance(error, Exception) and not isinstance(error, InputError):
            raise InputError(f"{what}: {problem_in(error, path)}; accepted: a file that "
                             "Python can import") from error  # fmt: skip
        raise
    _IMPORTED[str(path)] = digest


def _check(module: ModuleType, what: str) -> None:
    """Refuse a file without a reaction, or with one that lacks a method."""
    new = [kind for kind in REGISTRY.values() if kind.__module__ == module.__name__]
    if not new:
        raise InputError(
            f"{what}: no reaction in it; accepted: a class that inherits from tombo.Reaction and "
            "has a name"
        )
    for kind in new:
        if inspect.isabstract(kind):
            raise InputError(f"{what}: reaction '{kind.name}' has no begin(); accepted: one")
