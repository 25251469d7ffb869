"""Damage to a real log is named by the checks of the log alone."""

from pathlib import Path

import pytest

from tombo_benchmarks.diagnosis.mutations import MUTATIONS, SEED
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.readers.log_reader import read_logs

pytestmark = pytest.mark.slow

LOG = Path(__file__).parents[6] / "shared/data/flights/B10_lissajous_fast_rep1.csv.gz"


@pytest.mark.skipif(not LOG.exists(), reason=f"{LOG} is not there")
def test_what_one_log_can_show():
    (log,) = read_logs([LOG], mapping="nanobench")
    missed = []
    for k, mutation in enumerate(MUTATIONS):
        try:
            named = mutation.named_by(check_log(mutation.applied(log, 0, (SEED, k))).findings)
        except InputError as error:
            named = mutation.named_by_error(error)
        if not named:
            missed.append(mutation.name)
    assert missed == ["motors: all commands scaled by 0.8"]
    assert not [f for f in check_log(log).findings if f.severity != "info"]
