"""Logs, tables and mappings of others: damaged, too large or of another kind."""

import numpy as np
import pytest
from log_writers import write_ulog
from made_flight import made_flight, poses_only, with_series

from tombo_bag.flight import Series
from tombo_dynamics.errors import InputError
from tombo_logs.checks.pipeline import check_log
from tombo_logs.readers.log_reader import read_log

SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"


@pytest.fixture
def log():
    return poses_only(made_flight(duration=4.0, mocap_hz=25.0))


def test_a_damaged_ulog_is_read_before_and_behind_the_damage(tmp_path, log):
    path = tmp_path / "x.ulg"
    write_ulog(path, log)
    raw = path.read_bytes()
    middle = raw.index(b"D", len(raw) // 2) - 2  # between two messages, or all but
    path.write_bytes(raw[:middle] + b"\x00" * 700 + SYNC + raw[middle:])
    damaged = read_log(path, "x")
    assert any("damaged" in finding.message for finding in damaged.findings)
    assert 60 < damaged.series["position"].t.size <= 100


def test_stamps_that_reach_over_years_are_refused(log):
    late = {name: Series(np.append(s.t[:-1], 2e9), s.values) for name, s in log.series.items()}
    with pytest.raises(InputError, match="stamps reach over"):
        check_log(with_series(log, **late))
