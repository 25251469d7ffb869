"""Mapping files: YAML that says what the columns of a table are, of flights and thrust stands."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.yaml_text import read_text

M = TypeVar("M")
Parse = Callable[[str, str], M]
"""(text, name) to the mapping that is checked."""
_LARGEST = 200_000
"""Bytes; a mapping is some hundred."""


def shipped_mappings(package: str, folder: str, parse: Parse[M]) -> dict[str, M]:
    """Return the mappings in a folder of a package, by name."""
    files = resources.files(package).joinpath(folder).iterdir()
    names = {f.name.removesuffix(".yaml"): f for f in files if f.name.endswith(".yaml")}
    return {n: parse(f.read_text(encoding="utf-8"), n) for n, f in sorted(names.items())}


def read_mapping(name: str, known: Mapping[str, M], parse: Parse[M]) -> M:
    """Return a mapping: one of `known` by its name, or that of a YAML file.

    Raises:
        InputError: no such mapping, or one that can't be used.
    """
    path = Path(name)
    accepted = f"accepted: a YAML file, or {', '.join(known)}"
    if path.is_dir():
        raise InputError(f"mapping '{name}' is a folder; {accepted}")
    if not path.is_file():
        if name in known:
            return known[name]
        if path.suffix in (".yaml", ".yml") or path.parent != Path():
            raise InputError(f"mapping '{name}' is no file; {accepted}")
        raise unknown_name("mapping", name, [*known, "a YAML file"])
    return parse(read_text(path, f"mapping '{name}'", "a short YAML file", _LARGEST), name)


def table_of(content: object, what: str, accepted: Collection[str]) -> dict[str, Any]:
    """Return a table of a mapping file; of none, an empty one.

    Raises:
        InputError: it is no table, or has a key that is not accepted.
    """
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise InputError(f"{what} is {shown(content)}; accepted: {', '.join(accepted)}")
    for key in content:
        if key not in accepted:
            raise unknown_name(f"key of {what}", key, accepted)
    return {str(key): value for key, value in content.items()}
