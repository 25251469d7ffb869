"""Compile a function once per version of the sources, and keep the machine code on disk.

Numba's own cache checks only the file of a function. Machine code would go stale when a called
function in another file changes. Here the cache folder's name is a hash of
every source file that compiled code can come from: a change anywhere means a new folder. In it,
machine code is filed under the module's name, not under its path as numba does: the same sources
are found compiled whether they are imported from the workspace, a build folder or an installation.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, overload

if "coverage" in sys.modules:
    import numba
else:  # numba would load it where it is installed, in a sixth of its own time
    sys.modules["coverage"] = None  # type: ignore[assignment]
    import numba

    del sys.modules["coverage"]
from numba import types
from numba.core import cgutils, event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.runtime.nrt import rtsys
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


def _open_cache(root: Path, version: str) -> Path:
    folder = root / version
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        versions = sorted(
            (p for p in root.iterdir() if p.is_dir()), key=lambda p: p.stat().st_mtime
        )
        for old in versions[:-_KEPT_VERSIONS]:
            shutil.rmtree(old, ignore_errors=True)
    return folder


CACHE_FOLDER: Path = _open_cache(_root(), _source_hash())
_SUITE_CACHE, _added = CACHE_FOLDER, hashlib.sha256()


def add_sources(content: str) -> None:
    """Keep the machine code of modules that are loaded from now on apart from the suite's alone.

    Args:
        content: path and hash of a file whose code is compiled into theirs.
    """
    global CACHE_FOLDER
    _added.update(content.encode())
    CACHE_FOLDER = _open_cache(_SUITE_CACHE / "own", _added.hexdigest()[:16])


@cache
def _content_hash(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class _ModuleLocator(_CacheLocator):  # type: ignore[misc]
    """Files machine code under the module's name, and by what the source says, not how old it is.

    The content counts for what `_source_hash` does not see: effects in files of a user's own.
    """

    def __init__(self, function: Any, path: str) -> None:
        self._function, self._py_file, self._cache = function, path, CACHE_FOLDER

    @classmethod
    def from_function(cls, function: Any, path: str) -> _ModuleLocator:
        """Return the place of a function's machine code."""
        return cls(function, path)

    def ensure_cache_path(self) -> None:
        """Make the folder, when machine code is kept: `_open_cache` has tried to write."""
        os.makedirs(self.get_cache_path(), exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._cache / self._function.__module__)

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

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return machine code that was kept, or None.

        Numba would import all that it can compile first: a third of a second. It does so when
        there is something to compile, too.
        """
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)


def _no_extensions() -> None:
    """Stand for numba's search of all that is installed for extensions: there is none in use."""


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
    """Reports once that this process compiles: it takes minutes without any other output."""

    announced = False

    def on_start(self, event: Any) -> None:
        """Report it at the first function that is not in the cache."""
        if not self.announced:
            self.announced = True
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


def taking_rows(function: Any, records: int) -> Any:
    """Return a compiled function, its first arguments not records but arrays (1) of them.

    Python hands an array to compiled code in 0.3 us, a record in up to 10 us.
    """
    plain = getattr(function, "py_func", function)
    names = list(inspect.signature(plain).parameters)
    arguments = [f"{name}[0]" if i < records else name for i, name in enumerate(names)]
    source = [
        f"# machine code of {_content_hash(plain.__code__.co_filename)}",
        f"from {plain.__module__} import {plain.__name__}",
        "from tombo_dynamics.jit import compiled",
        "",
        "",
        "@compiled(inline=False)",
        f"def call({', '.join(names)}):",
        f"    return {plain.__name__}({', '.join(arguments)})",
        "",
    ]
    name = f"tombo_rows_{plain.__module__}_{plain.__name__}".replace(".", "_")
    return load_generated(name, "\n".join(source)).call


@overload
def compiled(function: _Function, /) -> _Function: ...


@overload
def compiled(*, inline: bool = True, counted: bool = True) -> Callable[[_Function], _Function]: ...


def compiled(
    function: _Function | None = None, /, *, inline: bool = True, counted: bool = True
) -> _Function | Callable[[_Function], _Function]:
    """Compile a function with numba (no GIL), cached on disk: `@compiled`, or with options.

    Arithmetic is strictly IEEE 754, in the order in which it is written: a function gives the same
    bits wherever it is inlined, in a node as in the headless flight. Division by zero gives inf or
    NaN as in C.

    Args:
        function: the decorated one.
        inline: into every caller; False: it is called, for what does not run in every tick.
            Inlining costs compile time, and saves what passing arrays costs: a few nanoseconds a
            call. A loop over many records is called too. For a record in a row of an array, LLVM
            would compute and store the address of each field: an eighth of a flight's time.
        counted: references to arrays are counted; False: in a tick's loop over many arrays that
            would be a fifth of a flight's time. Such a function cannot allocate an array.

    Raises:
        TypeError: uncounted, and it returns more than a number.
    """
    if function is None:
        return lambda decorated: _compile(decorated, inline, counted)
    return _compile(function, inline, counted)


def _compile(function: _Function, inline: bool, counted: bool) -> _Function:
    if not counted and function.__annotations__["return"] not in ("None", "bool", "int", "float"):
        raise TypeError(f"{function.__qualname__} returns more than a number")
    # always said whether references are counted: numba takes it from the caller otherwise
    # wrappers for C would be a sixteenth of the time to compile
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    decorated: Any = numba.njit(forceinline=inline, _nrt=counted, **options)(function)
    if isinstance(decorated, Dispatcher):  # NUMBA_DISABLE_JIT=1 gives the function itself
        decorated._cache = _FunctionCache(function)
        decorated._compilation_chain_init_hook = _no_extensions
    return decorated  # type: ignore[no-any-return]
