"""`tombo check mocap` on recordings, and what `tombo mocap` refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

_HEADER = "time,x,y,z,qx,qy,qz,qw"


def _write(path, position, attitude=(0.0, 0.0, 0.0, 1.0)) -> str:
    """Write a TUM trajectory of 10 s at 100 Hz."""
    t = np.arange(0.0, 10.0, 0.01)
    rows = np.column_stack([t, position(t), np.tile(attitude, (t.size, 1))])
    np.savetxt(path, rows, fmt="%.6f")
    return str(path)


def _carried(t):
    return np.column_stack([np.sin(0.5 * t), np.cos(0.4 * t), 1.0 + 0.3 * np.sin(t)])


def test_a_mistake_is_printed_with_its_mend_and_ends_with_one(tombo, tmp_path):
    log = _write(tmp_path / "poses.txt", lambda t: 1e3 * _carried(t))
    result = tombo("check", "mocap", log, "--json")
    assert result.code == 1
    (finding,) = [f for f in result.json["findings"] if f["key"] == "millimetres"]
    assert "metres" in finding["message"]
    assert result.json["good"] is False
    assert "millimetres" in tombo("check", "mocap", log).out


def test_figures_are_printed(tombo, tmp_path):
    turn = Rotation.from_euler("z", 30.0, degrees=True).as_quat()
    log = _write(tmp_path / "poses.txt", _carried, turn)
    figures = tombo("check", "mocap", log, "--json").json["figures"]
    assert figures["rate_hz"] == pytest.approx(100.0, rel=1e-3)
    assert figures["z_max_m"] == pytest.approx(1.3, abs=0.01)
    assert "100 Hz" in tombo("check", "mocap", log).out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("mocap", "kinect", "host"), "unknown mocap.system 'kinect'; accepted: "),
        (("mocap", "vicon"), "the address of the motion-capture computer"),
        (("mocap", "ros"), "the driver's topic"),
        (("mocap", "mock", "--up", "z"), "unknown mocap.up 'z'; accepted: y_up, z_up"),
        (("mocap", "mock", "--delay", "nan"), "mocap.delay"),
        (("check", "mocap", "nowhere.csv"), "nowhere.csv"),
        (("check", "mocap", "--seconds", "0"), "--seconds 0"),
    ],
)
def test_bad_input_is_named(refused, words, said):
    refused(words, said)
