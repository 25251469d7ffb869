"""`tombo arena`: goes on where it was stopped or killed; a page with all that was flown."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from suite_bench import wait_for

COMMAND = ("arena", "--seeds", "0:1", "--reactions", "bounce", "--clean")
COMMAND += ("--groups", "collisions,configurations")
ALONE, TOGETHER = ("--workers", "1"), ("--workers", "2")


def kept(folder: Path) -> list[str]:
    """Lines of the flights that are on disk before all are flown."""
    path = folder / "flights.jsonl"
    return path.read_text(encoding="utf-8").split("\n")[1:] if path.exists() else []


def flights(folder: Path) -> list[dict[str, object]]:
    """Rows of the table."""
    return pq.read_table(folder / "flights.parquet").to_pylist()


def interrupted(folder: Path, number: signal.Signals, lines: int) -> tuple[int, str]:
    """Run the command until it has kept so many lines; return how it ended by the signal."""
    with subprocess.Popen(
        [sys.executable, "-m", "tombo_bringup.cli.main", *COMMAND, *TOGETHER, "-o", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            wait_for(lambda: len(kept(folder)) >= lines, 120.0)
        finally:
            os.kill(process.pid, number)
        _, said = process.communicate(timeout=60)
        return process.returncode, said


@pytest.mark.slow
def test_what_was_killed_goes_on_and_ends_as_if_it_had_not_been(tombo, tmp_path):
    whole = tombo(*COMMAND, *ALONE, "-o", "whole", "--json")
    assert whole.code == 0
    flown = flights(tmp_path / "whole")

    folder = tmp_path / "killed"
    code, said = interrupted(folder, signal.SIGINT, 2)
    assert code == 130 and f"the same command with -o {folder} goes on" in said
    assert not (folder / "arena.json").exists()
    code, _ = interrupted(folder, signal.SIGKILL, 7)
    assert code == -signal.SIGKILL
    before = kept(folder)
    with (folder / "flights.jsonl").open("a", encoding="utf-8") as file:
        file.write('\n["arena", "bounce/pole/0/12345678", {"see')  # killed while it wrote
    again = tombo(*COMMAND, *ALONE, "-o", "killed", "--json")

    assert again.json == whole.json
    for name in ("arena.json", "arena.html"):
        assert (folder / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    after = flights(folder)
    assert [row["flight"] for row in after] == [row["flight"] for row in flown]
    figures = {row["flight"]: row for row in after}
    for line in before:
        _, key, row = json.loads(line)
        assert {name: figures[key][name] for name in row} == row

    assert again.json["refused"].keys() == {"Conf. 1", "Conf. 5", "Conf. 6", "Conf. 7"}
    page = (folder / "arena.html").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)  # nothing from elsewhere
    titles = re.findall(r"<h2>(.*?)</h2>", page)
    assert titles == [
        "Figures", "Fall and recovery", "Configurations 1 to 13",
        "Typical and worst flight of each reaction", "Not flown",
    ]  # fmt: skip
    assert page.index("<table") < page.index('<figure class="picture"')
    assert page.count('<figure class="picture"') == 2
    for number, shown in enumerate(again.json["shown"]):
        assert f'id="flight-{number}"' in page
        assert f"<code>{shown['command']}</code>" in page
    typical = again.json["shown"][0]
    alone = tombo(*typical["command"].split()[1:], "--no-record", "--json").json
    assert alone["max_falling_distance_m"] == typical["max_falling_distance_m"]


@pytest.mark.slow
def test_an_arena_grows_from_the_lines_of_an_earlier_version(tombo, tmp_path):
    words = ("arena", "--reactions", "bounce", "--clean", "--groups", "free", *ALONE, "-o", "a")
    assert tombo(*words, "--seeds", "0:2").code == 0
    first = flights(tmp_path / "a")
    lines = [["arena", row.pop("flight"), row] for row in first]
    for row in first:
        del row["reaction"], row["case"], row["group"], row["error"]
        row["strikes"] += 100  # tells it from one that is flown again
    (tmp_path / "a" / "flights.parquet").unlink()
    text = "\n".join(json.dumps(line) for line in lines)
    (tmp_path / "a" / "flights.jsonl").write_text(text)
    result = tombo(*words, "--seeds", "0:3", "--json").json
    assert [row["strikes"] for row in flights(tmp_path / "a")] == [100, 100, 0]
    assert result["all_cases"]["bounce"]["flights"] == 3
    assert tombo(*words, "--seeds", "0:1", "--json").json["all_cases"]["bounce"]["flights"] == 1
    assert len(flights(tmp_path / "a")) == 3
