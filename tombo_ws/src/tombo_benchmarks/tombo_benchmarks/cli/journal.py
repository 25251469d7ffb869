"""Scores of a benchmark's cases as they come: a benchmark that was stopped goes on."""

from __future__ import annotations

import json
from collections import UserDict
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError, shown

Row = dict[str, Any]


class Journal(UserDict[Any, Row]):
    """Rows by number or name, one a line of a file; a line cut by a kill is left out."""

    def __init__(self, path: Path, run: str) -> None:
        """Read the rows of an earlier run.

        Args:
            path: the file, made with the first row.
            run: command and seed of the rows.

        Raises:
            InputError: it is of another run.
        """
        super().__init__()
        self.path = path
        self._run = run
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
            try:
                kept_run, key, row = json.loads(line)
            except (ValueError, TypeError):
                continue
            if kept_run != run or not isinstance(key, int | str) or not isinstance(row, dict):
                raise InputError(
                    f"'{path}' is of {shown(kept_run)}, this is {shown(run)}; accepted: the same "
                    "command and seed, or another -o"
                )
            self.data[key] = row

    def __setitem__(self, key: Any, row: Row) -> None:
        """Append a row.

        Raises:
            OSError: it can't be written.
        """
        line = json.dumps([self._run, key, row], default=lambda number: number.tolist())  # numpy's
        with self.path.open("a", encoding="utf-8") as file:
            file.write(f"\n{line}")  # a line that a kill has cut ends here
        self.data[key] = row
