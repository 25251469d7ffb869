"""Requests in states over the simulated PX4: obeyed and seen, or refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_benchmarks.px4.services import SHOWS, fly_service


@pytest.mark.slow
@pytest.mark.parametrize(("service", "answer"), [("hold", "done"), ("takeoff", "refused")])
def test_a_request_while_it_lands_is_true_or_refused(tmp_path, service, answer):
    row = fly_service(Px4Setup(None, tmp_path / "px4"), service, "landing")
    assert row["wrong"] == "" and row["answer"].startswith(answer)


@pytest.mark.parametrize(
    ("service", "track"),
    [
        ("hold", [(1.0, 0.0, True, True), (0.0, 0.0, True, False)]),
        ("land", [(1.0, 0.0, False, True), (0.0, 0.0, False, True)]),
        ("kill", [(1.0, 0.0, True, True), (0.5, 0.0, True, True)]),
        ("takeoff", [(0.0, 0.0, False, True), (0.0, 0.0, False, False)]),
    ],
)
def test_what_is_not_seen_is_not_done(service, track):
    assert not SHOWS[service](np.array(track))
