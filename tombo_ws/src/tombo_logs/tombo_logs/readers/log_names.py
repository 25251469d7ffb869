"""Short and unique names of flights, from the names of their files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

_ENDINGS = (".gz", ".csv", ".ulg", ".tlog", ".bag", ".zstd", ".mcap", ".db3")
_GENERIC_NAME = re.compile(r"(flight|log|bag|rosbag|record(ing)?|data)?[\d_-]*", re.IGNORECASE)


def flight_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path: that of the file, else with folders or a number about it."""
    parts = _parts(paths)
    depth = [1] * len(parts)
    while True:
        names = ["/".join(p[-d:]) for p, d in zip(parts, depth, strict=True)]
        many = {name for name, count in Counter(names).items() if count > 1}
        longer = [i for i, p in enumerate(parts) if names[i] in many and depth[i] < len(p)]
        if not longer:
            return names
        for i in longer:
            depth[i] += 1


def _parts(paths: Sequence[Path]) -> list[tuple[str, ...]]:
    """Return folders and name of each path, no two alike.

    A file with a generic name gets that of its folder, and keeps its own where others are there,
    or where its number says so; what differs by the ending only gets a number.
    """
    whole = [_folders_and_name(path) for path in paths]
    generic = [
        bool(p[:-1] and _GENERIC_NAME.fullmatch(p[-1]) and not path.is_dir())
        for path, p in zip(paths, whole, strict=True)
    ]
    alone = Counter(p[:-1] for p, is_generic in zip(whole, generic, strict=True) if is_generic)

    def named(p: tuple[str, ...]) -> tuple[str, ...]:
        only = alone[p[:-1]] == 1 and not re.search("[1-9]", p[-1])
        return p[:-1] if only else (*p[:-2], "/".join(p[-2:]))

    parts = [named(p) if is_generic else p for p, is_generic in zip(whole, generic, strict=True)]
    seen: Counter[tuple[str, ...]] = Counter()
    for i, p in enumerate(parts):
        seen[p] += 1
        if seen[p] > 1:
            parts[i] = (*p[:-1], f"{p[-1]}#{seen[p]}")
    return parts


def _folders_and_name(path: Path) -> tuple[str, ...]:
    whole = path.absolute()
    stem = whole.name
    while stem.endswith(_ENDINGS):
        stem = stem.rpartition(".")[0]
    folders = [p for p in whole.parent.parts if p != whole.anchor]
    return (*folders, stem or whole.name)
