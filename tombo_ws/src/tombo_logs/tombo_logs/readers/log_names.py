"""Short and unique names of flights, from the names of their files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

_ENDINGS = (".gz", ".csv", ".ulg", ".tlog", ".bag", ".zstd", ".mcap", ".db3")
_GENERIC_NAME = re.compile(r"(flight|log|bag|rosbag|record(ing)?|data)?[0_-]*", re.IGNORECASE)


def flight_names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path: that of the file, with folders or a number where it is twice.

    A file with a generic name that is alone in its folder has the folder's name.
    """
    alone = Counter(path.absolute().parent for path in paths)
    parts = [_parts(path, alone[path.absolute().parent] == 1) for path in paths]
    for depth in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(p[-depth:]) for p in parts]
        if len(set(names)) == len(names):
            return names
    return [f"{'/'.join(p[-1:])}#{k}" for k, p in enumerate(parts, 1)]


def _parts(path: Path, alone: bool) -> tuple[str, ...]:
    """Return the folders of a path and its name without endings."""
    *folders, name = path.absolute().parts[1:]
    while name.endswith(_ENDINGS):
        name = name.rpartition(".")[0]
    if alone and folders and _GENERIC_NAME.fullmatch(name) and not path.is_dir():
        return tuple(folders)
    return (*folders, name)
