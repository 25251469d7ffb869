"""The command line in this process; processes that a test starts, and none of them after it."""

import pytest
from command_bench import refused, tombo
from suite_bench import marked

__all__ = ["marked", "refused", "tombo"]


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """Let standard error have what a command says, however long a busy machine takes."""
    monkeypatch.setattr("tombo_bringup.cli.progress._LINE_S", 1e9)
