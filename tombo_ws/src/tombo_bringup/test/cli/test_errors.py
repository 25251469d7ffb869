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


def test_bad_input_is_one_line_whatever_its_message(capsys):
    assert exit_code_of(raising(InputError("mass: -1\n is\tbad\x07"))) == 2
    assert capsys.readouterr().err == "Error: mass: -1 is bad\\x07\n"


def test_output_that_fails_is_one_line_with_the_file(capsys):
    assert exit_code_of(raising(PermissionError(13, "Permission denied", "/there"))) == 2
    assert capsys.readouterr().err == "Error: '/there': Permission denied\n"


def test_a_wrong_command_line_is_one_line(capsys):
    assert exit_code_of(raising(typer.BadParameter("no"))) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt(), typer.Abort()])
def test_an_interruption(error, capsys):
    assert exit_code_of(raising(error)) == 130
    assert "Traceback" not in capsys.readouterr().err


def test_a_code_that_a_command_leaves_with():
    assert exit_code_of(raising(typer.Exit(143))) == 143
    assert exit_code_of(lambda: 7) == 7
    assert exit_code_of(lambda: None) == 0


def test_a_bug_is_not_hidden():
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
