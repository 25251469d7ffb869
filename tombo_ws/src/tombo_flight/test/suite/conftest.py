"""Makes the bench importable; processes that a test starts, and none of them after it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from suite_bench import Marked


@pytest.fixture
def marked(tmp_path: Path) -> Iterator[Marked]:
    processes = Marked(tmp_path)
    yield processes
    processes.end_all()
