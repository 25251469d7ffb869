"""Short and unique names of flights, from the names of their files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

_ENDINGS = (".gz", ".csv", ".ulg", ".tlog", ".bag", ".zstd", ".mcap", ".db3")
_GENERIC_NAME = re.compile(r"(flight|log|bag|rosbag|record(ing)?|data)?[\d_-]*", re.IGNORECASE)


def flight_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path: that of the file, else with folders or a number before it."""
    parts = [_parts(path) for path in paths]
    depth = [1] * len(parts)
    names = [p[-1] for p in parts]
    for _ in range(max((len(p) for p in parts), default=0)):
        many = {name for name, count in Counter(names).items() if count > 1}
        if not many:
            return names
        for i, name in enumerate(names):
            if name in many and depth[i] < len(parts[i]):
                depth[i] += 1
                names[i] = "/".join(parts[i][-depth[i] :])
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        if seen[name] > 1:
            names[i] = f"{name}#{seen[name]}"
    return names


def _parts(path: Path) -> list[str]:
    """Return folders and name; a file with a generic name gets that of its folder."""
    whole = path.absolute()
    stem = whole.name
    while stem.endswith(_ENDINGS):
        stem = stem.rpartition(".")[0]
    folders = [p for p in whole.parent.parts if p != whole.anchor]
    if _GENERIC_NAME.fullmatch(stem) and folders and not path.is_dir():
        return folders
    return [*folders, stem or whole.name]
