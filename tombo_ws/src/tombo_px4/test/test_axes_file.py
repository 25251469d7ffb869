"""The proofs of the axes are kept, in order; the last one of a body counts."""

from dataclasses import replace

import pytest
import yaml

from tombo_dynamics.errors import InputError
from tombo_px4.bridge.axes_proof import AxesEvidence, AxesFile, valid_proof

RIGHT = AxesEvidence("2026-11-24T10:00:00+00:00", "s500", "a1b2", tilt_rad=[0.01, 0.0])
WRONG = AxesEvidence("2026-11-24T11:00:00+00:00", "s500", "a1b2", "x is not the nose")


def test_the_last_record_of_a_body_counts_and_none_is_lost(tmp_path):
    path = tmp_path / "more" / "axes.yaml"
    file = AxesFile(str(path))
    assert file.of_body("s500") == ()
    assert str(path) in file.add(RIGHT)
    assert valid_proof(AxesFile(str(path)).of_body("s500"), "a1b2") == RIGHT
    assert valid_proof(file.of_body("s500"), "c3d4") is None and file.of_body("other") == ()
    file.add(WRONG)
    assert valid_proof(file.of_body("s500"), "a1b2") is None
    assert len(yaml.safe_load(path.read_text())) == 2


@pytest.mark.parametrize("key", ["body", "vehicle"])
def test_a_proof_without_the_name_of_body_or_vehicle_is_not_kept(tmp_path, key):
    path = tmp_path / "axes.yaml"
    assert "for this run alone" in AxesFile(str(path)).add(replace(RIGHT, **{key: ""}))
    assert not path.exists() and AxesFile(str(path)).of_body("") == ()


def test_where_nothing_is_named_it_is_in_the_users_configuration(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    AxesFile("").add(RIGHT)
    assert (tmp_path / "tombo" / "px4_axes.yaml").is_file()


def test_simulated_poses_have_no_file():
    file = AxesFile("simulated")
    assert file.add(RIGHT) == "" and file.of_body("s500") == ()


@pytest.mark.parametrize(
    "text",
    ["{", "3", "- {date: now}", "- {date: a, body: b, x: 1}", "- {date: a, body: b, vehicle: c}"],
)
def test_another_file_is_refused(tmp_path, text):
    (tmp_path / "axes.yaml").write_text(text)
    with pytest.raises(InputError, match="no list of proofs of axes"):
        AxesFile(str(tmp_path / "axes.yaml")).of_body("s500")
