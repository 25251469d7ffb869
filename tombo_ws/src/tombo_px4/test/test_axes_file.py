"""The proofs of the axes are kept, in order; the last one of a body counts."""

import pytest
import yaml

from tombo_dynamics.errors import InputError
from tombo_px4.bridge.pose_axes import AxesEvidence, AxesFile

RIGHT = AxesEvidence("2026-11-24T10:00:00+00:00", "s500", 1, tilt_rad=(0.01, 0.0))
WRONG = AxesEvidence("2026-11-24T11:00:00+00:00", "s500", 1, "x is not the nose")


def test_the_last_record_of_a_body_counts_and_none_is_lost(tmp_path):
    path = tmp_path / "more" / "axes.yaml"
    file = AxesFile(str(path))
    assert file.last("s500", 1) is None
    assert str(path) in file.add(RIGHT)
    assert AxesFile(str(path)).last("s500", 1) == RIGHT
    assert file.last("s500", 2) is None and file.last("other", 1) is None
    file.add(WRONG)
    assert file.last("s500", 1) is None
    assert len(yaml.safe_load(path.read_text())) == 2


def test_where_nothing_is_named_it_is_in_the_users_configuration(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    AxesFile("").add(RIGHT)
    assert (tmp_path / "tombo" / "px4_axes.yaml").is_file()


def test_simulated_poses_have_no_file():
    file = AxesFile("simulated")
    assert file.add(RIGHT) == "" and file.last("s500", 1) is None


@pytest.mark.parametrize("text", ["{", "3", "- {date: now}", "- {date: a, body: b, x: 1}"])
def test_another_file_is_refused(tmp_path, text):
    (tmp_path / "axes.yaml").write_text(text)
    with pytest.raises(InputError, match="no list of proofs of axes"):
        AxesFile(str(tmp_path / "axes.yaml")).last("s500", 1)
