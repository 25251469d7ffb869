"""Sound flights in recordings that are wrong: nothing is said to have gone wrong in the air."""

from pathlib import Path

import numpy as np
import pytest

from tombo_bag.flight import RefusedLog, Series
from tombo_diagnosis.crash.reason import why
from tombo_logs.readers.log_reader import read_logs

CASES = Path(__file__).parents[6] / "shared" / "cases"
POSE = ("position", "attitude")
GROUPS = {
    "poses": POSE, "imu": ("gyro", "accel"), "accel": ("accel",), "commands": ("rotor_command",),
}  # fmt: skip
pytestmark = pytest.mark.slow


def read(name):
    path = CASES / name
    if not path.is_file():
        pytest.skip(f"no {path}")
    (log,) = read_logs([path])
    return log


def keys(found):
    return {f.key for f in found.findings}


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("clock_offset/same_clock.csv", None),
        ("clock_offset/poses_0.6s_ahead.csv", "other clock"),
        ("clock_offset/poses_0.35s_behind.csv", "other clock"),
        ("clock_offset/commands_0.6s_late.csv", "other clock"),
        ("ulog_other_clock/good.ulg", None),
        ("ulog_other_clock/sample_37s.ulg", "sample later"),
        ("ulog_other_clock/px4_12s.mcap", "other clock"),
        ("ulog_motor_outputs/outputs_pwm.ulg", None),
        ("ulog_motor_outputs/outputs_aux_first.ulg", "instance"),
        ("ulog_motor_outputs/outputs_dshot.ulg", None),
        ("ulog_motor_outputs/constant_commands.csv", "constant"),
    ],
)
def test_what_is_wrong_is_the_recording(name, key):
    found = why(read(name))
    assert found.cause == "none"
    said = keys(found) & {
        "other clock",
        "sample later",
        "instance",
        "constant",
        "ahead of arrival",
    }
    assert key in said if key else not said


@pytest.mark.parametrize("name", ["one_publisher.mcap", "two_publishers.mcap"])
def test_two_bodies_in_one_topic_are_refused(name):
    log = read(f"two_bodies_one_track/{name}")
    if name.startswith("one"):
        assert why(log).cause == "none"
        return
    with pytest.raises(RefusedLog) as refused:
        why(log)
    assert refused.value.finding.key == "bodies"


def moved(log, names, seconds):
    """The log with channels on a clock that is ahead."""
    series = {n: Series(log.series[n].t + seconds, log.series[n].values) for n in names}
    return log.with_series({**log.series, **series})


@pytest.mark.parametrize("seed", range(12))
def test_a_clock_that_is_off_by_any_time_is_no_crash(seed):
    rng = np.random.default_rng(seed)
    names = [*GROUPS.values()][seed % len(GROUPS)]
    offset = float(rng.uniform(0.35, 12.0) * rng.choice([-1.0, 1.0]))
    found = why(moved(read("clock_offset/same_clock.csv"), names, offset))
    assert found.cause in ("none", "unknown") and {"other clock", "unknown clock"} & keys(found)
    assert found.confidence < 0.95
