"""Compile a function once per version of the sources, and keep the machine code on disk.

Numba's own cache looks at the file that holds a function only, so machine code would go stale
when a function that it calls, in another file, changes. Here the cache folder's name is a hash of
every source file that compiled code can come from: a change anywhere means a new folder. In it,
machine code is filed under the module's name, not under its path as numba does: the same sources
are found compiled whether they are imported from the workspace, a build folder or an installation.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numba
from numba import types
from numba.core import cgutils, event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.extending import lower_cast

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


@cache
def _content_hash(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class _ModuleLocator(_CacheLocator):  # type: ignore[misc]
    """Files machine code under the module's name, and by what the source says, not how old it is.

    The content counts for what `_source_hash` does not see: effects in files of a user's own.
    """

    def __init__(self, function: Any, path: str) -> None:
        self._function, self._py_file = function, path

    @classmethod
    def from_function(cls, function: Any, path: str) -> _ModuleLocator:
        """Return the place of a function's machine code."""
        found = cls(function, path)
        found.ensure_cache_path()
        return found

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(CACHE_FOLDER / self._function.__module__)

    def get_source_stamp(self) -> str:
        """Return what must be the same for the machine code to count."""
        return _content_hash(self._py_file)

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name apart."""
        return str(self._function.__code__.co_firstlineno)


class _CacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_ModuleLocator,)


class _FunctionCache(FunctionCache):  # type: ignore[misc]
    _impl_class = _CacheImpl


def load_generated(name: str, source: str) -> ModuleType:
    """Return the module of a source that was written out, kept where its machine code is.

    Compiled code that is built at run time from closures could not be kept on disk.
    """
    path = CACHE_FOLDER / f"{name}.py"
    if not path.exists() or path.read_text() != source:
        handle, temporary = tempfile.mkstemp(dir=CACHE_FOLDER, suffix=".tmp")
        with os.fdopen(handle, "w") as stream:
            stream.write(source)
        os.replace(temporary, path)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


class _Announcer(event.Listener):  # type: ignore[misc]
    """Says once that this process compiles: it takes minutes in which nothing else is heard."""

    said = False

    def on_start(self, event: Any) -> None:
        """Say it at the first function that is compiled, not found."""
        if not self.said:
            self.said = True
            text = (
                "tombo: compiling numerical code, once for these sources; all of it takes some "
                f"minutes: {CACHE_FOLDER}"
            )
            print(text, file=sys.stderr, flush=True)  # noqa: T201

    def on_end(self, event: Any) -> None:
        """Do nothing."""


event.register("numba:compile", _Announcer())


@lower_cast(types.UniTuple, types.NestedArray)  # type: ignore[untyped-decorator]
def _tuple_to_field(context: Any, builder: Any, source: Any, field: Any, value: Any) -> Any:
    """Let a record's field take a tuple: `plant.force = add(plant.force, push)`."""
    if field.shape != (source.count,):
        raise TypeError(f"a field of shape {field.shape} cannot take {source.count} numbers")
    items = [
        context.cast(builder, item, source.dtype, field.dtype)
        for item in cgutils.unpack_tuple(builder, value)
    ]
    array = context.make_helper(builder, field)
    array.data = cgutils.alloca_once(
        builder, context.get_data_type(field.dtype), size=source.count
    )
    for i, item in enumerate(items):
        builder.store(item, cgutils.gep_inbounds(builder, array.data, i))
    return array._getvalue()


@lower_cast(types.Array, types.NestedArray)  # type: ignore[untyped-decorator]
def _array_to_field(context: Any, builder: Any, source: Any, field: Any, value: Any) -> Any:
    """Let a record's field take a row of an array, which must be long enough."""
    if source.layout != "C" or source.ndim != len(field.shape) or source.dtype != field.dtype:
        raise TypeError(f"a field of {field} cannot take {source}")
    return value


def compiled(function: _Function) -> _Function:
    """Compile `function` with numba (no GIL), cached on disk, always inlined.

    Arithmetic is strictly IEEE 754, in the order in which it is written: a function gives the same
    bits wherever it is inlined, in a node as in the headless flight. Division by zero gives inf or
    NaN as in C.
    """
    return _compile(function, inline=True)


def compiled_loop(function: _Function) -> _Function:
    """Compile as `compiled` does, for a tick's loop over many arrays.

    References to arrays are not counted in it, which would be a fifth of a flight's time: so it
    cannot allocate an array or return one.
    """
    if function.__annotations__["return"] not in ("None", "bool", "int", "float"):
        raise TypeError(f"{function.__qualname__} returns more than a number")
    return _compile(function, inline=True, counted=False)


def compiled_loop_call(function: _Function) -> _Function:
    """Compile as `compiled_loop` does, but for a call: for the loop itself.

    Its records are arguments. Of a record that is a row of an array, LLVM would work out the
    address of each field apart and keep it in memory, which costs an eighth of a flight's time.
    """
    return _compile(function, inline=False, counted=False)


def compiled_call(function: _Function) -> _Function:
    """Compile as `compiled` does, but for a call: for what does not run in every tick.

    Inlining costs compile time, and saves what passing arrays costs: a few nanoseconds a call.
    """
    return _compile(function, inline=False)


def _compile(function: _Function, inline: bool, counted: bool = True) -> _Function:
    # always said whether references are counted: numba takes it from the caller otherwise
    decorated: Any = numba.njit(nogil=True, forceinline=inline, error_model="numpy", _nrt=counted)(
        function
    )
    if isinstance(decorated, Dispatcher):  # NUMBA_DISABLE_JIT=1 gives the function itself
        decorated._cache = _FunctionCache(function)
    return decorated  # type: ignore[no-any-return]
