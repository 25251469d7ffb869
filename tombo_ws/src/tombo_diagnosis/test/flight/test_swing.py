"""Wind that swings is named with its speed; gusts, and a push that has no mean, are not it."""

import math

import pytest
from measured_flights import logs, nominal

from tombo_diagnosis.flight.diagnose import diagnose_flights

pytestmark = pytest.mark.slow

LENGTH = 22.0
"""s: eight swings."""

EAST, NORTH, SWING, FREQUENCY = 3.0, -1.5, 0.6, 0.37
WIND = {
    "steady_wind": {
        "east": EAST, "north": NORTH, "swing_east": SWING * EAST, "swing_north": SWING * NORTH,
        "frequency": FREQUENCY, "phase": 0.5,
    }
}  # fmt: skip


@pytest.mark.parametrize(("count", "sensors"), [(1, "imu_rpm"), (2, "mocap_rpm")])
def test_mean_amplitude_and_frequency_are_told(count, sensors):
    """To a tenth of the mean speed, and 0.01 Hz."""
    diagnosis = diagnose_flights(logs(WIND, 3, count, sensors, length=LENGTH), nominal())[0]
    assert diagnosis.verdict == "named"
    (cause,) = diagnosis.causes
    assert cause.effect == "steady_wind" and cause.confidence > 0.9
    wind = {f.name: f.value for f in cause.theta}
    close = pytest.approx(0.0, abs=0.1 * math.hypot(EAST, NORTH))
    for name, value in WIND["steady_wind"].items():
        if name not in ("frequency", "phase"):
            assert wind[name] - value == close
    assert wind["frequency"] == pytest.approx(FREQUENCY, abs=0.01)
    assert ("phase" in wind) == (count == 1)


GUSTS = {"deviation": 0.9, "time": 0.8}


@pytest.mark.parametrize(
    ("hidden", "more"),
    [
        ({"gusts": GUSTS, "steady_wind": {"east": EAST}}, {}),
        ({}, {"disturbance": ("periodic_push",)}),
        ({"steady_wind": {"east": 1.5}}, {"disturbance": ("tether",)}),
    ],
    ids=["gusts", "push", "tether"],
)
def test_other_forces_are_no_swing_of_the_wind(hidden, more):
    diagnosis = diagnose_flights(logs(hidden, seed=6, length=LENGTH, **more), nominal())[0]
    named = {f.name for c in diagnosis.causes for f in c.theta}
    assert not named & {"swing_east", "swing_north", "frequency"}
    if not hidden:
        assert diagnosis.verdict == "unknown"
