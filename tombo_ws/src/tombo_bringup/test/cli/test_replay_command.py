"""`tombo replay` on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

BAGS = Path(__file__).parents[5] / "tests" / "bags"
STRIKE = str(BAGS / "paper_collision_7.mcap")
WHOLE = str(BAGS / "paper_collision_0.mcap")


def test_json_is_one_object_with_all_that_came_out(tombo):
    result = tombo("replay", STRIKE, "--json")
    assert result.code == 0 and result.err == ""
    found = result.json
    assert list(found) == [
        "bag", "duration_s", "nodes", "differences", "findings", "damage", "speed",
    ]  # fmt: skip
    assert found["bag"] == STRIKE
    assert found["duration_s"] == pytest.approx(39.9, abs=0.1)
    detector = found["nodes"]["detector"]
    assert detector["matched"] == 1
    assert detector["x_c_error_m"] == [pytest.approx(0.0, abs=1e-9)]
    assert detector["events_replayed"][0]["stamp_s"] == pytest.approx(23.223)
    assert detector["false_alarms"] == 0
    assert found["speed"]["real_time_factor"] > 1.0


@pytest.mark.slow
def test_strict_makes_a_difference_an_error(tombo):
    other = ("replay", WHOLE, "--node", "detector", "--set", "detector.trigger=region")
    assert tombo(*other).code == 0
    strict = tombo(*other, "--strict")
    assert strict.code == 1
    assert "Difference: detector: x_c differs by" in strict.out


def test_parameters_come_from_a_file_over_the_bag_and_settings_over_both(tombo, tmp_path):
    (tmp_path / "mine.yaml").write_text("detector:\n  threshold: 5000\n")
    blind = tombo("replay", STRIKE, "--scenario", "mine.yaml", "--json")
    assert blind.json["nodes"]["detector"]["missed"] == 1
    seeing = ("--scenario", "mine.yaml", "--set", "detector.threshold=100")
    assert tombo("replay", STRIKE, *seeing, "--json").json["differences"] == []


def test_a_truncated_recording_is_replayed_and_the_damage_reported(tombo, tmp_path):
    data = Path(STRIKE).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: int(0.8 * len(data))])
    result = tombo("replay", "cut.mcap")
    assert result.code == 0
    assert "Damage: " in result.out and "cut off" in result.out
    (tmp_path / "stump.mcap").write_bytes(data[:3000])
    stump = tombo("replay", "stump.mcap")
    assert stump.code == 2
    assert "nothing to replay" in stump.err and "damage: " in stump.err
