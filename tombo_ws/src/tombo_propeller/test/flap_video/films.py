"""Small films of a propeller with a known flap, and their measurement."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from tombo_propeller.flap_video.camera_geometry import BladeSpan, CameraPose
from tombo_propeller.flap_video.measure import measure, reference_scale, spans_of
from tombo_propeller.flap_video.synthetic_video import Scene, SyntheticVideo, reference_scene

SPAN = BladeSpan(0.1111, 0.035)
SMALL = Scene(width=400, height=400, scale=1650.0, camera_height=8.0, off_centre=(6.0, -4.0))


@cache
def shots(scene, count=10, seed=0):
    return np.stack(list(SyntheticVideo(scene, seed).frames(count)))


def seen_by(scene):
    return CameraPose(scene.camera_height, scene.towards)


def reference(scene, seed=0, **changes):
    return shots(replace(reference_scene(scene), **changes), 32, seed)


def measured(scene, seed=0, windows=1, view=None, scale=None):
    view = view or seen_by(scene)
    give = lambda rim: scale or reference_scale(reference(scene, seed), 0.0, SPAN, view, rim)  # noqa: E731
    spans = spans_of(10 * windows, 10, windows)
    return measure(SyntheticVideo(scene, seed), spans, give, SPAN, view)


def write_folder(film, count, folder):
    """Write frames as PNG files, without loss."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, frame in enumerate(film.frames(count)):
        assert cv2.imwrite(str(folder / f"frame_{k:05d}.png"), frame)


def write_video(film, count, path):
    """Write frames as Motion JPEG (.avi)."""
    size = (film.scene.width, film.scene.height)
    code = cv2.VideoWriter.fourcc(*"MJPG")
    video = cv2.VideoWriter(str(path), code, film.scene.fps, size, isColor=False)
    assert video.isOpened()
    for frame in film.frames(count):
        video.write(frame)
    video.release()
