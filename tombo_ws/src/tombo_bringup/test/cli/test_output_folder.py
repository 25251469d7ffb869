"""Where results go: whole or not at all, and nothing of the user's is lost."""

from __future__ import annotations

import errno
import os

import pytest
from suite_bench import names

from tombo_flight import flight_output
from tombo_flight.process.output_folder import open_output

SHORT = ("hover", "--set", "duration=0.3")


FILES = {"flight.mcap", "summary.json", "scenario.yaml", "flight.png", "report.html"}


@pytest.mark.slow
def test_no_run_replaces_another_one_by_default(tombo, tmp_path):
    for _ in range(2):
        assert tombo("fly", *SHORT).code == 0

    assert names(tmp_path / "runs") == {"hover-0", "hover-0-2"}
    assert all(names(folder) == FILES for folder in (tmp_path / "runs").iterdir())


def test_a_numbered_folder_that_was_taken_meanwhile_gets_another_number(tmp_path):
    with open_output(tmp_path / "o", replace=False, numbered=True) as folder:
        (folder / "summary.json").write_text("ours")
        (tmp_path / "o" / "summary.json").write_text("theirs")
        folder.publish()

    assert (tmp_path / "o" / "summary.json").read_text() == "theirs"
    assert folder.path == tmp_path / "o-2"
    assert (folder.path / "summary.json").read_text() == "ours"


def test_a_numbered_folder_of_a_run_that_failed_is_gone(tmp_path):
    with (
        pytest.raises(RuntimeError),
        open_output(tmp_path / "runs" / "o", replace=False, numbered=True) as folder,
    ):
        (folder / "summary.json").write_text("half")
        raise RuntimeError
    assert names(tmp_path) == set()


@pytest.mark.parametrize("file", ["notes.txt", "summary.json", ".hidden"])
def test_a_folder_that_is_not_empty_is_refused(refused, tmp_path, file):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / file).write_text("mine")

    refused(("fly", *SHORT, "-o", "full"), "full", file, "--force")

    assert (tmp_path / "full" / file).read_text() == "mine"


@pytest.mark.slow
def test_force_replaces_results_and_leaves_other_files(tombo, tmp_path):
    folder = tmp_path / "full"
    folder.mkdir()
    for name in ("notes.txt", "summary.json", "flight.mcap"):
        (folder / name).write_text("old")

    assert tombo("fly", *SHORT, "-o", "full", "--force").code == 0

    assert names(folder) == {"notes.txt", *FILES}
    assert (folder / "notes.txt").read_text() == "old"
    assert (folder / "summary.json").read_text() != "old"


@pytest.mark.parametrize(
    "where", ["file", "file/below", "/proc/nowhere/o", "/dev/null/o", "x" * 300, "loop/o"]
)
def test_a_place_that_cannot_be_written_is_refused_before_the_flight(
    refused, tmp_path, monkeypatch, where
):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.setattr(flight_output, "fly_into", lambda *a, **k: pytest.fail("flown"))

    refused(("fly", *SHORT, "-o", where), f"output folder '{where}'", "accepted")

    assert (tmp_path / "file").read_text() == "mine"


def test_a_full_disk_is_one_line_and_leaves_nothing(refused, monkeypatch):
    def full(record, path):
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(flight_output, "write_mcap", full)
    refused(("fly", "hover", "--set", "duration=0.3"), "No space left on device", "runs/hover-0")
