"""`tombo report`: the page appears whole in a folder of its own, or is refused by name."""

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


def test_the_page_is_in_a_folder_as_the_results_of_other_commands(tombo, log, tmp_path):
    assert tombo("report", *log).code == 0
    assert tombo("report", *log).code == 0
    assert names(tmp_path / "runs") == {"report-log", "report-log-2"}
    assert names(tmp_path / "runs" / "report-log") == {"report.html"}
    assert tombo("report", *log, "-o", "mine").code == 0
    assert tombo("report", *log, "-o", "mine", "--force").code == 0


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
