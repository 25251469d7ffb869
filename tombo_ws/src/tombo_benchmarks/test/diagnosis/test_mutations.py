"""Damage to a real log is named by the checks of the log alone."""

from pathlib import Path

import pytest

from tombo_bag.flight import Flight
from tombo_benchmarks.diagnosis import mutations
from tombo_benchmarks.diagnosis.mutations import MUTATIONS, SEED, ask_all
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.readers.log_reader import read_logs

LOG = Path(__file__).parents[6] / "shared/data/flights/B10_lissajous_fast_rep1.csv.gz"


@pytest.mark.slow
@pytest.mark.skipif(not LOG.exists(), reason=f"{LOG} is not there")
def test_what_one_log_can_show():
    (log,) = read_logs([LOG], mapping="nanobench")
    missed = []
    for k, mutation in enumerate(MUTATIONS):
        try:
            named = mutation.named_by(check_log(mutation.applied(log, (SEED, k))).findings)
        except InputError as error:
            named = mutation.named_by_error(error)
        if not named:
            missed.append(mutation.name)
    assert missed == ["motors: all commands scaled by 0.8"]
    assert not [f for f in check_log(log).findings if f.severity != "info"]


def test_the_ways_are_those_that_have_something_to_compare_with(monkeypatch):
    """Without a vehicle file, --vehicle is no way to ask."""
    asked = []
    log = Flight.measured("new", "", {})
    monkeypatch.setattr(mutations, "diagnose_unchecked", lambda *_: [asked.append("plain")])
    monkeypatch.setattr(
        mutations, "diagnose_change_unchecked", lambda *_: [asked.append("healthy")]
    )
    monkeypatch.setattr(mutations, "MUTATIONS", ())
    monkeypatch.setattr(mutations, "_answers_about", lambda *_: set())
    ask_all(log, None, [log])
    assert asked == ["plain", "healthy"]
