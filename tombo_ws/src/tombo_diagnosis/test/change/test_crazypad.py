"""Real flights of one Crazyflie with known causes, where they are on this machine."""

from functools import cache
from pathlib import Path

import pytest

from tombo_diagnosis.change.diagnose import NEEDED, diagnose_change
from tombo_diagnosis.flight.diagnose import check_flights
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_logs.readers.log_reader import read_logs

ROOT = Path(__file__).resolve().parents[5]
FOLDER = ROOT.parent / "shared" / "data" / "crazypad"
CAUSES = {
    "weight_w1_near_m3": {"added_weight"}, "weight_w3_near_m3": {"added_weight"},
    "cut_m3_both_tips_1mm": {"weak_propeller"}, "cut_m3_both_tips_2mm": {"weak_propeller"},
    "cut_m3_one_tip_1mm": {"weak_propeller", "propeller_unbalance"},
    "cut_m3_3mm": {"weak_propeller"}, "string_w2_m3": {"hanging_load"},
    "string_w3_m3": {"hanging_load"}, "tape_m3": {"weak_propeller"},
}  # fmt: skip
"""Each of rotor 3, rear left; `tape_m1_m3` has two rotors."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER.is_dir(), reason=f"real data absent: no {FOLDER}"),
]


def flights(condition):
    paths = sorted(FOLDER.glob(f"{condition}_[0-9].csv.gz"))
    logs = read_logs(paths, ROOT / "examples" / "crazypad.yaml")
    return check_flights(logs, needed=NEEDED)[0]


NOMINAL = cache(nominal_model)


@pytest.fixture(scope="module")
def healthy():
    return flights("normal")


def test_what_is_reported_is_right_and_covers_most_conditions(healthy):
    diagnosis = set()
    for condition, causes in CAUSES.items():
        result = diagnose_change(flights(condition), healthy, NOMINAL())[0]
        if result.verdict in ("named", "set"):
            assert len(result.changed) <= 3, condition
            assert {c.effect for c in result.changed if c.rotor == "rear_left"} & causes, condition
            diagnosis.add(condition)
    assert len(diagnosis) >= 6


def test_no_healthy_flight_is_named(healthy):
    """One against the others, and the second day against the first."""
    sides = [([one], [log for log in healthy if log is not one]) for one in healthy]
    for new, old in (*sides, (healthy[3:], healthy[:3])):
        assert diagnose_change(new, old, NOMINAL())[0].verdict == "none", new[0].name
