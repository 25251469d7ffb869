"""The combined frames with the hull, the paper's circle and the rim drawn in."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.measure import FlapMeasurement

Picture = NDArray[np.uint8]
_Colour = tuple[int, int, int]

_RIM: _Colour = (0, 94, 213)  # blue, green, red
_HULL: _Colour = (233, 180, 86)
_STRAIGHT: _Colour = (115, 158, 0)
_SIDE = 620
_ZOOMED = 360
"""Pixels of the panel that shows a piece of the rim."""
_ZOOM_SPAN = 36.0
"""Pixels of the film that it shows."""
_BANNER = 30
_SUB = 4
"""Bits of a pixel in what is drawn."""


def overlay(found: FlapMeasurement) -> Picture:
    """Return the picture (height, width, 3): the disc with its circles, and a piece of the rim."""
    window = found.windows[0]
    rim = window.rim
    dark, light = found.picture.min(axis=0), found.picture.max(axis=0)
    usual = np.median(found.picture, axis=0)
    # Of each pixel the frame in which it is furthest from what stands still: the disc fills up.
    filled = np.where(usual - dark > light - usual, dark, light).astype(np.uint8)
    straight = found.scale.pixels_per_m * found.span.tip
    phi: Any = np.linspace(0.0, 2.0 * math.pi, 721)
    oval = rim.oval[0] * np.cos(2.0 * phi) + rim.oval[1] * np.sin(2.0 * phi)
    disc = window.disc
    circles = [
        (_outline(rim.x, rim.y, straight + oval, phi), _STRAIGHT),
        (_outline(disc.x, disc.y, np.full_like(phi, disc.radius), phi), _HULL),
        (_outline(rim.x, rim.y, rim.radius + oval, phi), _RIM),
    ]
    hull = (disc.hull, (190, 190, 190))

    factor = _SIDE / max(filled.shape)
    whole = _shown(filled, (0.0, 0.0), factor, (round(filled.shape[1] * factor), _SIDE)[:2])
    whole = whole[: round(filled.shape[0] * factor)]
    for line, colour in [hull, *circles]:
        _draw(whole, line, (0.0, 0.0), factor, colour)
    at = ((rim.x + 0.5) * factor - 0.5, (rim.y + 0.5) * factor - 0.5)
    cv2.drawMarker(whole, (round(at[0]), round(at[1])), _RIM, cv2.MARKER_CROSS, 14, 1)

    corner = _piece(light.astype(float) - dark, rim.x, rim.y, rim.radius)
    zoom = _ZOOMED / _ZOOM_SPAN
    piece = _shown(filled, corner, zoom, (_ZOOMED, _ZOOMED))
    for line, colour in circles:
        _draw(piece, line, corner, zoom, colour, 2)
    text = [
        (f"{_ZOOM_SPAN:.0f} x {_ZOOM_SPAN:.0f} pixels at the rim", (90, 90, 90)),
        (f"rim        {rim.radius:8.2f} px", _RIM),
        (f"hull's circle {disc.radius:8.2f} px", (200, 120, 20)),
        (f"straight blades {straight:8.2f} px", _STRAIGHT),
    ]
    height = max(whole.shape[0], _ZOOMED + 24 * len(text) + 10)
    sheet = np.full((_BANNER + height, whole.shape[1] + 10 + _ZOOMED, 3), 255, np.uint8)
    sheet[_BANNER : _BANNER + whole.shape[0], : whole.shape[1]] = whole
    sheet[_BANNER : _BANNER + _ZOOMED, whole.shape[1] + 10 :] = piece
    result = found.overall if found.steady else window.angle
    _write(sheet, f"flap {result.as_text()}", (4, 20), (40, 40, 40))
    for k, (line_, colour) in enumerate(text):
        _write(sheet, line_, (whole.shape[1] + 12, _BANNER + _ZOOMED + 22 + 24 * k), colour)
    return sheet


def write_picture(picture: Picture, path: Path) -> None:
    """Write a picture.

    Raises:
        InputError: it can't be written.
    """
    if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise InputError(f"can't write '{path}'; accepted: a folder that can be written")


def _piece(swing: Array, x: float, y: float, radius: float) -> tuple[float, float]:
    """Return the corner of the piece of the rim at which a blade stands out most."""
    phi: Any = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    at = _outline(x, y, np.full_like(phi, 0.96 * radius), phi).round().astype(int)
    height, width = swing.shape
    inside = (at >= 0).all(axis=1) & (at < (width, height)).all(axis=1)
    smooth = cv2.GaussianBlur(swing, (0, 0), 3.0)
    best = max(np.flatnonzero(inside), key=lambda k: float(smooth[at[k][1], at[k][0]]), default=0)
    middle = (x + radius * math.cos(phi[best]), y + radius * math.sin(phi[best]))
    return middle[0] - 0.5 * _ZOOM_SPAN, middle[1] - 0.5 * _ZOOM_SPAN


def _outline(x: float, y: float, out: Array, phi: Array) -> Array:
    return np.column_stack([x + out * np.cos(phi), y + out * np.sin(phi)])


def _shown(
    grey: Picture, corner: tuple[float, float], factor: float, size: tuple[int, int]
) -> Picture:
    """Return the part of `grey` from `corner` on, `factor` times as large, in colour channels."""
    into = np.array([
        [factor, 0.0, (0.5 - corner[0]) * factor - 0.5],
        [0.0, factor, (0.5 - corner[1]) * factor - 0.5],
    ])  # fmt: skip
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.4 / factor) if factor < 0.9 else grey
    part = cv2.warpAffine(smooth, into, size, flags=cv2.INTER_LINEAR if factor < 2 else 0)
    return np.asarray(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _draw(
    picture: Picture,
    line: Array,
    corner: tuple[float, float],
    factor: float,
    colour: _Colour,
    thickness: int = 1,
) -> None:
    points = (line - corner + 0.5) * factor - 0.5
    fixed = np.round(points * (1 << _SUB)).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(picture, [fixed], True, colour, thickness, cv2.LINE_AA, _SUB)


def _write(picture: Picture, text: str, place: tuple[int, int], colour: _Colour) -> None:
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
