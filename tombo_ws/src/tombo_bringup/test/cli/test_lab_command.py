"""The lab file: its options reach the commands, those of the command line win."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tombo_bringup.lab_file import read_lab
from tombo_dynamics.errors import InputError

LAB = {
    "tombo_lab": 1,
    "vehicle": "tombo_s500",
    "mocap": {"system": "vicon", "host": "10.0.0.2", "body": "lab_1", "up": "y_up"},
    "px4": {
        "url": "serial:///dev/ttyUSB0:921600",
        "parameters": ["safe", "mocap"],
        "bridge": {"link": {"allow_remote": True}},
    },
    "volume": {"x_min": -1.6, "x_max": 1.7},
}


def lab_file(folder: Path, **changes: object) -> Path:
    path = folder / "lab.yaml"
    path.write_text(yaml.safe_dump({**LAB, **changes}, sort_keys=False))
    return path


def merged(folder: Path, **given: object) -> dict:
    return read_lab(lab_file(folder)).merged(given)


def test_a_flight_gets_vehicle_and_volume(tmp_path):
    given = {"vehicle": None, "settings": ["volume.x_max=2.0"], "px4": None, "seed": 3}
    assert merged(tmp_path, **given) == {
        "vehicle": "tombo_s500",
        "settings": ["volume.x_min=-1.6", "volume.x_max=1.7", "volume.x_max=2.0"],
        "px4": None,
        "seed": 3,
    }
    assert merged(tmp_path, vehicle="mine.yaml") == {"vehicle": "mine.yaml"}


def test_px4_gets_url_and_bridge_only_where_it_flies(tmp_path):
    values = merged(tmp_path, px4="lab", bridge=["link.allow_remote=false"])
    assert values["px4"] == "serial:///dev/ttyUSB0:921600"
    assert values["bridge"] == [
        "px4.tracked_body=lab_1",
        'px4_parameters=["safe", "mocap"]',
        "link.allow_remote=true",
        "link.allow_remote=false",
    ]
    assert merged(tmp_path, px4=None, bridge=None)["bridge"] is None
    assert merged(tmp_path, px4="sim", bridge=None)["px4"] == "sim"
    url = "udpin://127.0.0.1:5"
    assert merged(tmp_path, px4=url, bridge=None)["px4"] == url


def test_the_motion_capture_is_that_of_the_lab_unless_another_is_named(tmp_path):
    names = ("system", "host", "body", "up", "nose", "delay", "bodies", "options")
    nothing = dict.fromkeys(names)
    of_lab = merged(tmp_path, **nothing)
    assert [of_lab[name] for name in names[:5]] == ["vicon", "10.0.0.2", "lab_1", "y_up", "+x"]
    other = merged(tmp_path, **{**nothing, "system": "mock", "up": "z_up"})
    assert [other[name] for name in names[:4]] == ["mock", None, "lab_1", "z_up"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tombo_lab": 2}, "tombo_lab: 1"),
        ({"cameras": 8}, "cameras"),
        ({"mocap": {"system": "kinect"}}, "kinect"),
        ({"mocap": {"system": "vicon"}}, "mocap.host"),
        ({"mocap": [1]}, "mocap"),
        ({"px4": {"uri": "x"}}, "uri"),
        ({"volume": 3}, "volume"),
    ],
)
def test_a_mistake_in_the_file_is_named(tmp_path, changes, said):
    with pytest.raises(InputError, match=said):
        read_lab(lab_file(tmp_path, **changes))


def test_a_file_that_is_written_lacks_nothing_and_flies(tombo, tmp_path):
    assert tombo("lab", "new", "lab.yaml", "--set", "mocap.host=10.0.0.2").code == 0
    assert tombo("lab", "check", "lab.yaml").code == 0
    line = ("fly", "hover", "--lab", "lab.yaml", "-o", "flown")
    assert tombo(*line, "--set", "volume.x_max=1.9").code == 0
    volume = yaml.safe_load((tmp_path / "flown/scenario.yaml").read_text())["volume"]
    assert (volume["x_min"], volume["x_max"]) == (-2.0, 1.9)


def test_what_a_lab_lacks_is_said(tombo, tmp_path):
    (tmp_path / "lab.yaml").write_text("tombo_lab: 1\nvolume: {x_min: -1.0, x_max: 1.0}\n")
    result = tombo("lab", "check", "lab.yaml", "--json")
    assert result.code == 1
    lacks = {item["name"]: item["lacks"] for item in result.json}
    assert "tombo vehicle new" in lacks["vehicle"]
    assert "system, host, body" in lacks["motion capture"]
    assert "safe and mocap" in lacks["PX4 parameters"]
    assert "px4.url" in lacks["PX4"]


def test_a_command_that_takes_no_lab_says_so(refused, tmp_path):
    lab_file(tmp_path)
    refused(("why", "--lab", "lab.yaml", "x.mcap"), "No such option: --lab")
    refused(("fly", "--lab", "nowhere.yaml"), "nowhere.yaml")
