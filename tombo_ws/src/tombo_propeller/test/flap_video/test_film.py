"""Films on disk: what is read, and what is refused with a reason."""

import cv2
import numpy as np
import pytest
from films import SMALL, shots, write_folder, write_video

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.synthetic_video import SyntheticVideo
from tombo_propeller.flap_video.video import open_video


@pytest.mark.slow
def test_a_folder_gives_the_frames_back(tmp_path):
    write_folder(SyntheticVideo(SMALL), 12, tmp_path / "film")
    film = open_video(tmp_path / "film")
    assert (film.count, film.fps) == (12, 960.0)
    parts = list(film.parts([(2, 5), (9, 14)]))
    assert [(first, len(frames)) for first, frames in parts] == [(2, 3), (9, 3)]
    assert (parts[0][1] == shots(SMALL, 12)[2:5]).all()


def test_pictures_are_in_order_of_their_numbers(tmp_path):
    for k in (10, 9, 1):
        cv2.imwrite(str(tmp_path / f"shot{k}.png"), np.full((80, 80), k, np.uint8))
    ((_, frames),) = open_video(tmp_path).parts([(0, 3)])
    assert [int(f[0, 0]) for f in frames] == [1, 9, 10]


@pytest.mark.slow
def test_a_video_gives_nearly_the_frames_back(tmp_path):
    write_video(SyntheticVideo(SMALL), 12, tmp_path / "film.avi")
    film = open_video(tmp_path / "film.avi")
    assert (film.count, film.fps) == (12, 960.0)
    ((first, frames),) = film.parts([(3, 6)])
    assert first == 3 and frames.shape == (3, 400, 400)
    assert np.abs(frames.astype(int) - shots(SMALL, 12)[3:6]).mean() < 6.0
    assert not list(film.parts([(12, 20)]))


@pytest.mark.slow
def test_a_playback_rate_is_noticed(tmp_path):
    from dataclasses import replace

    write_video(SyntheticVideo(replace(SMALL, fps=30.0)), 3, tmp_path / "film.avi")
    assert "playback" in open_video(tmp_path / "film.avi").notes[0]
    assert open_video(tmp_path / "film.avi", 960.0).notes == ()


def test_what_is_no_film_is_refused(tmp_path):
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "empty").mkdir()
    for path, why in [("text.mp4", "no video"), ("empty", "no pictures"), ("none", "exists")]:
        with pytest.raises(InputError, match=why):
            open_video(tmp_path / path)
    with pytest.raises(InputError, match="fps"):
        open_video(tmp_path / "empty", -1.0)


def test_pictures_that_do_not_belong_together_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((80, 80), np.uint8))
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((90, 80), np.uint8))
    with pytest.raises(InputError, match="one size"):
        list(open_video(tmp_path).parts([(0, 2)]))
    (tmp_path / "b.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="can't read"):
        list(open_video(tmp_path).parts([(0, 2)]))
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(InputError, match="64 or more"):
        list(open_video(tmp_path).parts([(0, 1)]))
