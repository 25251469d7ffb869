"""Some hundred damaged files of every kind: each is read, or refused in one line."""

import pytest

from fuzz.pool import fuzz
from fuzz.samples import make_samples

COUNT = 280


@pytest.mark.slow
def test_damaged_files_are_read_or_refused(tmp_path):
    done = fuzz(make_samples(tmp_path / "whole"), range(COUNT), 2, str(tmp_path))
    assert not done.faults, "\n".join(f"{f.sample}, seed {f.seed}: {f.why}" for f in done.faults)
    assert done.accepted > COUNT / 4
    assert done.refused > COUNT / 8
    assert done.accepted + done.refused == COUNT
