"""The command line in this process, in an empty working directory."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tombo_bringup.cli.main import run


@dataclass(frozen=True)
class Result:
    """Output of a command on the terminal."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as JSON: it must be that alone, and strict."""

        def refuse(name: str) -> None:
            raise AssertionError(f"{name} is no JSON")

        return json.loads(self.out, parse_constant=refuse)


Command = Callable[..., Result]
COMPILING = "tombo: compiling numerical code"
"""Said once by a process whose cache is cold: not part of a command's output."""


@pytest.fixture
def tombo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Command:
    """Run `tombo ...` in an empty folder, the current one."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str) -> Result:
        capsys.readouterr()
        with pytest.raises(SystemExit) as leave:
            run(arguments)
        code = leave.value.code
        written = capsys.readouterr()
        lines = written.err.splitlines(keepends=True)
        err = "".join(line for line in lines if not line.startswith(COMPILING))
        return Result(code if isinstance(code, int) else 0, written.out, err)

    return command


@pytest.fixture
def refused(tombo: Command, tmp_path: Path) -> Callable[..., None]:
    """Run a command that is refused: exit code 2, one line with these words, nothing written."""

    def check(arguments: tuple[str, ...], *words: str) -> None:
        before = sorted(tmp_path.rglob("*"))
        result = tombo(*arguments)
        assert (result.code, result.out) == (2, ""), result.err
        assert result.err.startswith("Error: ") and result.err.count("\n") == 1, result.err
        for word in words:
            assert word in result.err, result.err
        assert sorted(tmp_path.rglob("*")) == before

    return check
