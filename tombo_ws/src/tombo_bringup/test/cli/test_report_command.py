"""`tombo report`: the page appears whole, at a place that is a file, or is refused by name."""

import os
import stat
from pathlib import Path

import pytest
from suite_bench import names

from tombo_bringup.cli.report_command import different_names


@pytest.fixture
def log(tmp_path):
    """Six poses: enough for a page."""
    rows = [f"{0.1 * k},{k},0,1,0,0,0,1" for k in range(6)]
    columns = [f"position_{x}" for x in "xyz"] + [f"attitude_{x}" for x in "xyzw"]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([",".join(["t", *columns]), *rows]))
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(
        "time: {column: t, unit: s}\nchannels:\n"
        "  position: {columns: [position_x, position_y, position_z], unit: m}\n"
        "  attitude: {columns: [attitude_x, attitude_y, attitude_z, attitude_w], order: xyzw}\n"
    )
    return [str(path), "--mapping", str(mapping)]


def test_the_figures_of_a_log(tombo, log):
    figures = tombo("report", *log, "--json").json["logs"][0]["figures"]
    assert figures["poses [Hz]"] == pytest.approx(10.0)


@pytest.mark.parametrize("place", ["absent/page.html", "log.csv/page.html", "folder"])
def test_a_page_that_cannot_be_written_is_refused_by_its_name(tombo, log, tmp_path, place):
    (tmp_path / "folder").mkdir()
    before = names(tmp_path)
    result = tombo("report", *log, "-o", place, "--force")
    assert result.code == 2
    assert place in result.err and "unfinished" not in result.err and "accepted" in result.err
    assert names(tmp_path) == before


def test_what_is_no_file_is_never_replaced(tombo, log, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    result = tombo("report", *log, "-o", "pipe", "--force")
    assert result.code == 2 and "it is no file" in result.err
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.parametrize(
    ("names", "files", "called"),
    [
        (["hover", "survey"], ["a/x.mcap", "b/x.mcap"], ["hover", "survey"]),
        (["recording"], ["monday_bag"], ["monday_bag"]),
        (["hover", "hover"], ["monday.ulg", "tuesday.ulg"], ["monday", "tuesday"]),
        (["hover", "hover"], ["a/x.mcap", "b/x.mcap"], ["a/x", "b/x"]),
        (["hover", "hover"], ["a/x.mcap", "a/x.mcap"], ["1 a/x", "2 a/x"]),
    ],
)
def test_flights_on_a_page_have_names_that_tell_them_apart(names, files, called):
    assert different_names(names, [Path("/lab", file) for file in files]) == called
