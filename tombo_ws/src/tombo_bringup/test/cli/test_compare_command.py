"""`tombo compare` on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest
from suite_bench import names

BAGS = Path(__file__).parents[5] / "tests" / "bags"
FIRST = str(BAGS / "paper_collision_0.mcap")
OTHER = str(BAGS / "paper_collision_7.mcap")


def test_equal_recordings_exit_with_0(tombo):
    result = tombo("compare", FIRST, FIRST)
    assert result.code == 0 and result.err == ""
    assert "Nothing differs on 8 topics." in result.out


def test_different_recordings_exit_with_1_and_a_table(tombo):
    result = tombo("compare", FIRST, OTHER, "--topic", "/mocap/pose")
    assert result.code == 1 and result.err == ""
    words = " ".join(result.out.split())
    assert "/mocap/pose 1204 1198 differs 0 pose.position.x" in words
    assert "1 of 1 topics differ." in words


@pytest.mark.slow
def test_json_is_written_and_other_files_stay(tombo, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    result = tombo("compare", FIRST, OTHER, "-o", "out", "--json")
    assert names(tmp_path / "out") == {"compare.json", "mine.txt"}
    assert (tmp_path / "out" / "compare.json").read_text() == result.out
