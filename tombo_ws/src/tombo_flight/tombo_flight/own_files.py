"""Effects and reactions from files of the user, in this process and in the flying processes.

    python -m tombo_flight.own_files FILE... -- MODULE [ARGUMENT ...]

runs a module, such as that of a node, after the files were imported.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import runpy
import sys
from collections.abc import Iterable, Sequence
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tombo_collision import reactions
from tombo_dynamics import effects, jit
from tombo_dynamics.effects import Effect
from tombo_dynamics.errors import InputError, problem_in
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import fill_record
from tombo_dynamics.vehicle import VehicleParams

_IMPORTED: dict[str, str] = {}
"""Absolute path → a hash of the content, of the files that are imported in this process."""
_NORMALS = 9
"""Standard normal numbers that an effect gets in a tick."""
_COMPOSED = "tombo_dynamics.effects.compose"
"""The module that compiles all effects together when it is imported."""
_ACCEPTED = (
    "a file with a function that @effect decorates, or a subclass of tombo.Reaction with its name"
)


def imported_files() -> tuple[tuple[str, str], ...]:
    """Return absolute path and a hash of the content of each file that was imported."""
    return tuple(_IMPORTED.items())


def import_files(paths: Iterable[str | Path]) -> None:
    """Import Python files, each with the effects and reactions that it defines.

    A file that was imported before stays. Effects are compiled into the flight, so they come
    before the first one of a process.

    Raises:
        InputError: no such file, it fails, it defines nothing that can be flown, or it comes late.
    """
    for path in paths:
        _import(str(path))


def with_imports(module: str) -> tuple[str, ...]:
    """Return arguments of Python that run a module with the files of this process."""
    if not _IMPORTED:
        return ("-m", module)
    return ("-m", __name__, *_IMPORTED, "--", module)


class _Loader(SourceFileLoader):
    """Writes no compiled file into the user's folder."""

    def set_data(self, path: str, data: Any, *, _mode: int = 0o666) -> None:
        """Keep nothing."""


def _import(given: str) -> None:
    """Import a file; on an error the registries are as before."""
    path, what = Path(given).resolve(), f"--import '{given}'"
    if str(path) in _IMPORTED:
        return
    if path.suffix != ".py" or not path.is_file():
        raise InputError(f"{what}: no such file; accepted: {_ACCEPTED}")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    registries: tuple[dict[str, Any], ...] = (effects.REGISTRY, reactions.REGISTRY)
    before = [dict(registry) for registry in registries]
    # A name of its own, the same in each process, so that objects can be sent between them, and
    # in each folder, so that machine code is found again.
    name = f"{path.stem}_{digest}"
    spec = importlib.util.spec_from_file_location(name, path, loader=_Loader(name, str(path)))
    assert spec is not None and spec.loader is not None  # of every file that ends with .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # for modules in its folder
    try:
        spec.loader.exec_module(module)
        if _enter(module, what):
            jit.add_sources(name)
    except BaseException as error:
        del sys.modules[name]
        for registry, entries in zip(registries, before, strict=True):
            registry.clear()
            registry.update(entries)
        if isinstance(error, Exception) and not isinstance(error, InputError):
            raise InputError(f"{what}: {problem_in(error, path)}; accepted: a file that "
                             "Python can import") from error  # fmt: skip
        raise
    _IMPORTED[str(path)] = digest


def _enter(module: ModuleType, what: str) -> bool:
    """Check the effects and reactions of a module; return whether it has effects: compiled code.

    `what`: begins the message of an error.
    """
    name = module.__name__
    new_effects = [effect for effect in effects.REGISTRY.values() if effect.module == name]
    new_reactions = [kind for kind in reactions.REGISTRY.values() if kind.__module__ == name]
    if not [*new_effects, *new_reactions]:
        raise InputError(f"{what}: nothing that can be flown; accepted: {_ACCEPTED}")
    for kind in new_reactions:
        if inspect.isabstract(kind):
            lacks = " and ".join(f"{method}()" for method in sorted(kind.__abstractmethods__))
            raise InputError(f"{what}: {kind.__name__} has no {lacks}; accepted: with it")
    if new_effects and _COMPOSED in sys.modules:
        raise InputError(
            f"{what}: effects are compiled into the flight, and this process has loaded it; "
            "accepted: import the file first"
        )
    for effect in new_effects:
        _try(effect, what)
    return bool(new_effects)


def _try(effect: Effect, what: str) -> None:
    """Compile an effect, and refuse one that changes a vehicle by its null values."""
    plant = Plant.new()
    for name, declared in Plant.fields.items():
        if declared.kind is float:  # no division by zero in what the effect reads
            plant[name] = 1.0
    plant.state.attitude[3] = plant.state.position[2] = 1.0
    fill_record(plant.vehicle, VehicleParams())
    before = plant.tobytes()
    memory = [] if effect.state is None else [effect.state.new()]
    nulls = [float(parameter.null) for parameter in effect.theta]
    plain = getattr(effect.function, "py_func", effect.function)
    # compiled apart: numba would take code for `Plant` for that of a `SimulatedPlant`, too
    function = jit.compiled(plain)
    try:
        function(plant, np.zeros(_NORMALS), *memory, *nulls)
    except Exception as error:
        raise InputError(
            f"{what}: effect '{effect.name}': {problem_in(error)}; accepted: a function that "
            "numba can compile"
        ) from error
    if plant.tobytes() != before:
        raise InputError(
            f"{what}: effect '{effect.name}' changes the vehicle when its parameters are null; "
            "accepted: one that then does nothing"
        )


def _main(words: Sequence[str]) -> None:
    """Import files, then run a module as `python -m` does, in this process.

    Args:
        words: FILE... -- MODULE [ARGUMENT ...].
    """
    files = words[: words.index("--")]
    import_files(files)
    sys.argv = list(words[len(files) + 1 :])
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    # `__main__` is a second copy of this module, with a `_IMPORTED` that others do not see
    from tombo_flight.own_files import _main as main_of_the_module

    main_of_the_module(sys.argv[1:])
