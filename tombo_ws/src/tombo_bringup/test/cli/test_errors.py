"""Exceptions to exit codes, in one place."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import typer

from tombo_bringup.cli.errors import exit_code_of
from tombo_dynamics.errors import InputError


def raising(error: BaseException):
    def command() -> None:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (InputError("mass: -1\n is\tbad\x07"), 2, "Error: mass: -1 is bad\\x07\n"),
        (PermissionError(13, "denied", "/there"), 2, "Error: '/there': denied\n"),
        (typer.BadParameter("no"), 2, "Error: Invalid value: no\n"),
        (KeyboardInterrupt(), 130, "Error: interrupted\n"),
        (typer.Abort(), 130, "Error: interrupted\n"),
        (typer.Exit(143), 143, ""),
    ],
)
def test_an_exception_is_a_code_and_one_line(error, code, said, capsys):
    assert exit_code_of(raising(error)) == code
    assert capsys.readouterr().err == said


def test_a_result_is_a_code_and_a_bug_is_not_hidden():
    assert (exit_code_of(lambda: 7), exit_code_of(lambda: None)) == (7, 0)
    with pytest.raises(ZeroDivisionError):
        exit_code_of(raising(ZeroDivisionError()))


@pytest.mark.slow
def test_a_reader_that_leaves_early_is_no_error():
    read, write = os.pipe()
    os.close(read)
    run = subprocess.run(
        [sys.executable, "-m", "tombo_bringup.cli.main", "list", "scenarios"],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(write)
    assert run.stderr == ""
    assert run.returncode in (1, 141)
