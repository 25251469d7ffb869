"""A wish to stop that somebody swallows: nothing is published, and the exit code says so."""

from __future__ import annotations

import os
import signal
import time

import pytest

from tombo_propeller.design import design
from tombo_propeller.reproduce import page, reproduction


def interrupted(work):
    """Return `work` during which Ctrl-C comes where an exception is ignored, as in a callback."""

    def run(*arguments, **named):
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)
        except BaseException:
            pass
        return work(*arguments, **named)

    return run


@pytest.mark.parametrize("where", [("-o", "out"), ("--json",)])
def test_reproduce(tombo, tmp_path, monkeypatch, where):
    monkeypatch.setattr(reproduction, "reproduce", interrupted(lambda laws: None))
    monkeypatch.setattr(page, "write_reproduction", lambda folder, found, tell: None)
    result = tombo("propeller", "reproduce", *where)
    assert (result.code, result.out, result.err) == (130, "", "Error: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_design(tombo, tmp_path, monkeypatch):
    monkeypatch.setattr(design, "design", interrupted(design.design))
    result = tombo("propeller", "design", "--mass", "1.3", "--flights", "0", "-o", "out")
    assert result.code == 130 and result.out == ""
    assert not list(tmp_path.iterdir())
