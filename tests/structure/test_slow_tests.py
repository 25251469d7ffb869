"""What `make check` leaves out is there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIST = ROOT / "tests" / "slow_tests.txt"


def test_every_slow_test_exists():
    gone = []
    for line in LIST.read_text().split():
        path, _, function = line.partition("::")
        pattern = rf"^ *def {function.split('::')[-1]}\(" if function else ""
        known = (ROOT / path).exists()
        if not known or (pattern and not re.search(pattern, (ROOT / path).read_text(), re.M)):
            gone.append(line)
    assert not gone, f"{LIST.name} names what is not there: {gone}"
