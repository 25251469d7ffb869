"""`tombo arena`: goes on where it was stopped or killed; a page with all that was flown."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from suite_bench import wait_for

COMMAND = ("arena", "--seeds", "0:1", "--reactions", "bounce", "--clean")
COMMAND += ("--groups", "collisions,configurations")
ALONE, TOGETHER = ("--workers", "1"), ("--workers", "2")


def kept(folder: Path) -> list[str]:
    """Lines of the file of flights."""
    path = folder / "flights.jsonl"
    return path.read_text(encoding="utf-8").split("\n")[1:] if path.exists() else []


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
    flown = len(kept(tmp_path / "whole"))

    folder = tmp_path / "killed"
    code, said = interrupted(folder, signal.SIGINT, 2)
    assert (code, said) == (130, f"Error: interrupted; the same command goes on with '{folder}'\n")
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
    after = kept(folder)
    assert after[: len(before)] == before
    keys = [json.loads(line)[1] for line in after if line.endswith("]")]
    assert len(keys) == len(set(keys)) == flown

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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--seeds", "5"), ("--seeds 5", "A:B")),
        (("--seeds", "0:10001"), ("--seeds 0:10001", "10000")),
        (("--reactions", "bounce,nothing"), ("--reactions", "nothing", "reflex")),
        (("--groups", "maps"), ("--groups", "maps", "speed_offset")),
        (("--workers", "0"), ("--workers 0", "1 to 1024")),
        (("-o", ""), ("-o", "no name")),
        (("-o", "file"), ("-o file", "can't be written")),
        (("-o", "full"), ("-o full", "not empty", "--force")),
    ],
)
def test_bad_input_is_refused(refused, tmp_path, options, words):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    refused(("arena", *options), *words)
