"""Read a film: a video that OpenCV can read, or a folder of pictures, as grey frames."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.disc import Frames

PAPER_FPS = 960.0
_PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"}
_LEAST_SIDE = 64
_PLAYBACK = 200.0
"""Frames per second below which a file may carry the rate of its playback in slow motion."""


@dataclass(frozen=True)
class Video:
    """A film on disk."""

    path: Path
    pictures: tuple[Path, ...]
    """Of a folder, in order; empty for a video."""
    count: int
    fps: float
    notes: tuple[str, ...]

    def parts(self, spans: list[tuple[int, int]]) -> Iterator[tuple[int, Frames]]:
        """Yield (first frame, frames) of spans [first, behind) that rise and do not overlap.

        Spans behind the film's end come out short or not at all.

        Raises:
            InputError: a frame can't be read, or is of another size than the first.
        """
        yield from self._of_folder(spans) if self.pictures else self._of_video(spans)

    def _of_folder(self, spans: list[tuple[int, int]]) -> Iterator[tuple[int, Frames]]:
        size: tuple[int, ...] | None = None
        for first, behind in spans:
            frames = []
            for path in self.pictures[first:behind]:
                frame = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                if frame is None:
                    raise InputError(f"can't read '{path}'; accepted: whole pictures")
                size = _checked(frame, size, path)
                frames.append(np.asarray(frame, dtype=np.uint8))
            if frames:
                yield first, np.stack(frames)

    def _of_video(self, spans: list[tuple[int, int]]) -> Iterator[tuple[int, Frames]]:
        video = _opened(self.path)
        position = 0
        size: tuple[int, ...] | None = None
        try:
            for first, behind in spans:
                frames = []
                while position < first and video.grab():
                    position += 1
                while first <= position < behind:
                    is_read, frame = video.read()
                    if not is_read:
                        break
                    position += 1
                    size = _checked(frame, size, self.path)
                    frames.append(_grey(frame))
                if frames:
                    yield first, np.stack(frames)
                if position < behind:
                    return
        finally:
            video.release()


def open_video(path: Path, fps: float | None = None) -> Video:
    """Look at a film; without `fps` the file's own rate counts, for pictures the paper's.

    Raises:
        InputError: no such path, no video, no pictures, or a rate that is none.
    """
    if fps is not None and not 0.0 < fps < 1e7:
        raise InputError(f"--fps {fps:g}; accepted: frames per second, above 0, below 1e+07")
    if path.is_dir():
        pictures = sorted(
            (p for p in path.iterdir() if p.suffix.lower() in _PICTURES and p.is_file()),
            key=_natural,
        )
        if not pictures:
            raise InputError(f"'{path}' holds no pictures; accepted: PNG, JPEG, TIFF, BMP, PGM")
        return Video(path, tuple(pictures), len(pictures), fps or PAPER_FPS, ())
    if not path.is_file():
        raise InputError(f"no video or folder '{path}'; accepted: one that exists")
    video = _opened(path)
    count, rate = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), float(video.get(cv2.CAP_PROP_FPS))
    video.release()
    notes: list[str] = []
    if fps is None:
        if not 0.0 < rate < 1e7:
            raise InputError(f"'{path}' has no frame rate; accepted: --fps with the camera's")
        if rate < _PLAYBACK:
            notes.append(
                f"the file says {rate:g} frames/s: if that is the playback's and not the "
                "camera's, give --fps; times and rpm depend on it, angles don't"
            )
    return Video(path, (), max(count, 0), fps or rate, tuple(notes))


def _opened(path: Path) -> cv2.VideoCapture:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # both write to standard error
    cv2.setLogLevel(0)
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not video.isOpened():
        video.release()
        raise InputError(f"'{path}' is no video that can be read; accepted: MP4, AVI, MKV, ...")
    return video


def _grey(frame: Any) -> NDArray[np.uint8]:
    if frame.ndim == 3:
        frame = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    return np.asarray(frame, dtype=np.uint8)


def _checked(
    frame: NDArray[np.generic], size: tuple[int, ...] | None, path: Path
) -> tuple[int, ...]:
    shape = frame.shape[:2]
    if min(shape) < _LEAST_SIDE:
        raise InputError(
            f"'{path}' is {shape[1]} x {shape[0]} pixels; accepted: {_LEAST_SIDE} or more a side"
        )
    if size is not None and shape != size:
        raise InputError(
            f"'{path}' is {shape[1]} x {shape[0]} pixels, frames before it {size[1]} x {size[0]}; "
            "accepted: frames of one size"
        )
    return shape


def _natural(path: Path) -> list[tuple[int, str]]:
    """Order frame9 before frame10."""
    return [
        (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)
    ]
