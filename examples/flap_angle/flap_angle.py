"""Measure the flap angle of a turning propeller in a film along its axis.

    pip install -r requirements.txt
    python flap_angle.py FAST.mp4 --reference SLOW.mp4 --camera-height 3000

The reference shows the same propeller to the same camera, so slow that its blades do not flap.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import cv2
import numpy as np
from camera_geometry import BladeSpan, CameraPose, FlapAngle, angle, paper_angle
from disc import Disc, Frames, find_disc

RADIUS_SD_PX = 1.0
"""Standard deviation of a hull's radius [pixels]: motion blur hides the tip's last pixel."""


def read_frames(path: Path, first: int, count: int) -> Frames:
    """Return grey frames of a video, or of a folder of pictures in the order of their names.

    Raises:
        ValueError: no frames there, or fewer than asked for.
    """
    if path.is_dir():
        pictures = sorted(path.iterdir())[first : first + count]
        frames = [cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE) for picture in pictures]
    else:
        video = cv2.VideoCapture(str(path))
        frames = [video.read()[1] for _ in range(first + count)][first:]
        frames = [f if f is None else cv2.cvtColor(f, cv2.COLOR_BGR2GRAY) for f in frames]
    if len(frames) < count or any(frame is None for frame in frames):
        raise ValueError(f"'{path}': no frames {first} to {first + count - 1}; accepted: a film")
    return np.stack([np.asarray(frame, dtype=np.uint8) for frame in frames])


def flap_angle(disc: Disc, at_rest: Disc, span: BladeSpan, view: CameraPose) -> FlapAngle:
    """Return the flap angle, from the discs of the fast and of the straight blades."""
    scale = span.tip / at_rest.radius  # m per pixel
    radius = disc.radius * scale
    shares = RADIUS_SD_PX / disc.radius, RADIUS_SD_PX / at_rest.radius
    return angle(radius, radius * math.hypot(*shares), span, view)


def main() -> None:
    """Measure windows of a film and print an angle with its 95 % interval for each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("film", type=Path, help="video, or folder of pictures")
    parser.add_argument("--reference", type=Path, required=True, help="film of straight blades")
    parser.add_argument("--camera-height", type=float, required=True, help="lens to disc [mm]")
    parser.add_argument("--from-below", action="store_true", help="blades flap away from it")
    parser.add_argument("--tip-radius", type=float, default=111.1, help="[mm] (the paper's)")
    parser.add_argument("--nodus-radius", type=float, default=35.0, help="[mm] (the paper's)")
    parser.add_argument("--window", type=int, default=10, help="frames combined (default: 10)")
    parser.add_argument("--windows", type=int, default=1, help="how many, one after the other")
    asked = parser.parse_args()
    try:
        span = BladeSpan(1e-3 * asked.tip_radius, 1e-3 * asked.nodus_radius)
        view = CameraPose(1e-3 * asked.camera_height, towards=not asked.from_below)
        at_rest = find_disc(read_frames(asked.reference, 0, 3 * asked.window))
        for first in range(0, asked.window * asked.windows, asked.window):
            disc = find_disc(read_frames(asked.film, first, asked.window))
            paper = paper_angle(disc.radius * span.tip / at_rest.radius, span)
            print(
                f"frames {first} to {first + asked.window - 1}: "
                f"{flap_angle(disc, at_rest, span, view).as_text()}; "
                f"paper's formula: {math.degrees(paper):.1f} deg"
            )
    except ValueError as error:
        sys.exit(f"Error: {error}")


if __name__ == "__main__":
    main()
