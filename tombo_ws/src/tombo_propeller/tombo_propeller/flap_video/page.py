"""A measurement of the flap angle as a page of results, and its files: JSON, table, pictures."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM
from tombo_flight.report.figure import new_figure
from tombo_flight.report.page import Item, Page, Picture, Section, Table, Text, page_json
from tombo_flight.report.style import BLUE, GREEN, RC, SKY, VERMILLION
from tombo_propeller.flap_video.camera_geometry import (
    CameraPose,
    FlapAngle,
    ambiguous_angle_limit,
    angle,
)
from tombo_propeller.flap_video.measure import FlapMeasurement, VideoWindow

BETA_FILES = ("beta.json", "beta.csv", "beta.png", "overlay.png")
_COLUMNS = ("time_s", "rpm", "beta_deg", "beta_low_deg", "beta_high_deg", "radius_px",
            "radius_sd_px", "radius_mm", "hull_radius_px", "paper_beta_deg", "words")  # fmt: skip
_FAR = 20.0
"""Camera heights in tip radii above which perspective hides little."""
_MOST_ROWS = 20
Image = NDArray[np.uint8]
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


def beta_page(measurement: FlapMeasurement, remarks: Sequence[str] = ()) -> Page:
    """Return the result of a measurement; `remarks` come before its own notes."""
    scale = measurement.scale
    notes = [*remarks, *notes_of(measurement)]
    together = [f"All {len(measurement.windows)} windows: {measurement.overall.as_text()}"]
    drawing = Picture(lambda: draw_beta(measurement), "Flap angle and radius of the disc")
    items: list[Item] = [_window_table(measurement), drawing]
    if measurement.steady:
        items.insert(1, Text(together))
    return Page(
        title="Flap angle",
        eyebrow="Tombo propeller, flap angle from a film",
        headline=f"Flap angle: {_outcome(measurement)}",
        summary=f"Scale {scale.pixels_per_m * 1e-3:.4f} px/mm +- {100 * scale.error:.3f} % "
        f"({scale.source})",
        sections=[
            Section("By windows", items),
            Section("Notes", [Text([f"{note}." for note in notes], "list")] if notes else []),
        ],
        data=_beta_data(measurement, notes),
    )


def write_beta(folder: Path, measurement: FlapMeasurement, page: Page) -> None:
    """Write all files of a measurement into a folder that exists.

    Raises:
        InputError: the picture can't be written.
    """
    picture = folder / "overlay.png"
    if not cv2.imwrite(str(picture), overlay(measurement), [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise InputError(f"can't write '{picture}'; accepted: a folder that can be written")
    with mpl.rc_context(RC):  # the number of ticks is chosen when a figure is saved
        draw_beta(measurement).savefig(folder / "beta.png", dpi=130)
    (folder / "beta.json").write_text(page_json(page), encoding="utf-8")
    with (folder / "beta.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(_COLUMNS)
        table.writerows(_row(window) for window in measurement.windows)


def _window_table(measurement: FlapMeasurement) -> Table:
    rows = [
        (
            f"{w.time:.4f}",
            f"{w.speed / RPM:.0f}",
            f"{w.rim.radius:.2f}",
            f"{w.radius * 1e3:.2f}",
            "-" if math.isnan(w.paper) else f"{math.degrees(w.paper):.1f}",
            w.angle.as_text(),
        )
        for w in measurement.windows[:: math.ceil(len(measurement.windows) / _MOST_ROWS)]
    ]
    head = ("time s", "speed rpm", "rim px", "disc mm", "paper's formula deg", "beta")
    return Table(head, rows)


def _outcome(measurement: FlapMeasurement) -> str:
    return measurement.overall.as_text() if measurement.steady else "it changes over the film"


def _beta_data(measurement: FlapMeasurement, notes: Sequence[str]) -> dict[str, Any]:
    """Return the measurement for JSON; angles in degrees, None where none can be named."""
    scale, view = measurement.scale, measurement.view
    return {
        "beta": _angle(measurement.overall) if measurement.steady else None,
        "steady": measurement.steady,
        "windows": [_window(w) for w in measurement.windows],
        "skipped": list(measurement.skipped),
        "scale": {
            "px_per_mm": scale.pixels_per_m * 1e-3,
            "error_share": scale.error,
            "source": scale.source,
        },
        "camera": {
            "height_mm": view.height * 1e3,
            "blades_flap_towards_it": view.towards,
            "tilt_deg": math.degrees(measurement.windows[0].rim.tilt),
        },
        "blade": {"tip_mm": measurement.span.tip * 1e3, "nodus_mm": measurement.span.nodus * 1e3},
        "notes": list(notes),
    }


def _angle(a: FlapAngle) -> dict[str, Any]:
    return {
        "deg": _best_deg(a),
        "low_deg": math.degrees(a.low),
        "high_deg": math.degrees(a.high),
        "pieces_deg": np.degrees(a.pieces),
        "words": a.as_text(),
    }


def _best_deg(a: FlapAngle) -> float | None:
    return math.degrees(a.best) if a.resolved and not a.inconsistent else None


def _window(w: VideoWindow) -> dict[str, Any]:
    return {
        "first_frame": w.first,
        "frames": w.frames,
        "time_s": w.time,
        "rpm": w.speed / RPM,
        "beta": _angle(w.angle),
        "radius_px": w.rim.radius,
        "radius_sd_px": w.rim.sd,
        "radius_mm": w.radius * 1e3,
        "hull_radius_px": w.disc.radius,
        "paper_beta_deg": math.degrees(w.paper),
    }


def _row(w: VideoWindow) -> list[float | str]:
    """Return the line of a window; beta_deg is empty where the diameter does not resolve it."""
    return [
        round(w.time, 6), rounded(w.speed / RPM, 1), rounded(_best_deg(w.angle), 3),
        round(math.degrees(w.angle.low), 3), round(math.degrees(w.angle.high), 3),
        round(w.rim.radius, 3), round(w.rim.sd, 4), round(w.radius * 1e3, 4),
        round(w.disc.radius, 2), rounded(math.degrees(w.paper), 2), w.angle.as_text(),
    ]  # fmt: skip


def rounded(value: float | None, digits: int) -> float | str:
    """Return a number for a table, an empty cell if it is not known."""
    return "" if value is None or not math.isfinite(value) else round(value, digits)


def notes_of(measurement: FlapMeasurement) -> list[str]:
    """Return what a reader of the angle has to know."""
    notes = []
    span, view = measurement.span, measurement.view
    if math.isinf(view.height):
        seen = angle(
            measurement.radius, measurement.radius_sd, span, CameraPose(1.0, view.towards)
        )
        notes.append(
            "no --camera-height: taken to be far away. With the camera at 1 m the same disc means "
            + seen.as_text()
        )
    else:
        blind = ambiguous_angle_limit(span, view)
        if blind > 0.0:
            notes.append(
                f"perspective is taken out (camera at {view.height:.3g} m). From above the disc "
                f"first grows: below {math.degrees(blind):.1f} deg two angles look the same; from "
                "below they don't (--from-below)"
            )
        if view.height < _FAR * span.tip and view.towards:
            notes.append("the camera is near: further away, or below, resolves smaller angles")
    if not measurement.scale.relative:
        notes.append(
            "the scale is absolute: tip shape and scale limit small angles; frames of the same "
            "propeller at low speed (--reference) do not have that error"
        )
    rim = measurement.windows[0].rim
    if math.hypot(*rim.oval) > 4.0 * rim.oval_sd and math.degrees(rim.tilt) > 2.0:
        how = "in the reference too: it cancels" if measurement.scale.relative else "taken out"
        notes.append(f"the camera is tilted by {math.degrees(rim.tilt):.1f} deg, {how}")
    if not measurement.steady:
        notes.append("the angle changes over the film: see the windows")
    if measurement.overall.inconsistent:
        notes.append(
            f"the disc has {measurement.radius * 1e3:.2f} mm, more than any flap gives: check "
            "scale, camera height and --from-below"
        )
    if measurement.skipped:
        notes.append(f"{len(measurement.skipped)} windows left out; {measurement.skipped[0]}")
    return notes


def draw_beta(measurement: FlapMeasurement) -> Figure:
    """Draw each window's angle with its interval, the paper's formula, and the disc's radius."""
    with new_figure(8.0, 5.4, 100, layout="constrained") as figure:
        angles, radii = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        t = np.array([w.time for w in measurement.windows])
        if measurement.steady:
            low, high = (
                math.degrees(a) for a in (measurement.overall.low, measurement.overall.high)
            )
            angles.axhspan(low, high, color=SKY, alpha=0.35, lw=0, label="all windows, 95 %")
        for window in measurement.windows:
            for piece in window.angle.pieces:
                angles.plot([window.time] * 2, np.degrees(piece), color=BLUE, lw=2.2, alpha=0.8)
        named = [w for w in measurement.windows if w.angle.resolved and not w.angle.inconsistent]
        angles.plot([], [], color=BLUE, lw=2.2, label="a window, 95 %")
        angles.plot([w.time for w in named], [math.degrees(w.angle.best) for w in named], "o",
                    color=BLUE, ms=4, label="most likely, where resolved")  # fmt: skip
        by_paper = np.degrees([w.paper for w in measurement.windows])
        angles.plot(
            t, by_paper, "x", color=VERMILLION, ms=5, label="paper's formula on the hull's circle"
        )
        angles.set_ylabel("flap β [deg]")
        angles.set_ylim(bottom=-0.3)
        angles.legend(loc="best")
        figure.suptitle(f"Flap angle: {_outcome(measurement)}", fontsize=10.5)
        radius = np.array([w.radius for w in measurement.windows]) * 1e3
        sd = np.array([w.radius_sd for w in measurement.windows]) * 1e3
        radii.errorbar(t, radius, yerr=1.96 * sd, fmt="o", ms=3, color=BLUE, label="disc")
        radii.axhline(measurement.span.tip * 1e3, color=GREEN, lw=1.0, label="straight blades")
        radii.set_ylabel("apparent radius [mm]")
        radii.set_xlabel("time [s]")
        radii.legend(loc="best")
    return figure


def overlay(measurement: FlapMeasurement) -> Image:
    """Return the picture (height, width, 3): the disc with its circles, and a piece of the rim."""
    window = measurement.windows[0]
    rim = window.rim
    dark, light = measurement.picture.min(axis=0), measurement.picture.max(axis=0)
    usual = np.median(measurement.picture, axis=0)
    # Of each pixel the frame in which it is furthest from what stands still: the disc fills up.
    filled = np.where(usual - dark > light - usual, dark, light).astype(np.uint8)
    straight = measurement.scale.pixels_per_m * measurement.span.tip
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
    result = measurement.overall if measurement.steady else window.angle
    _write(sheet, f"flap {result.as_text()}", (4, 20), (40, 40, 40))
    for k, (line_, colour) in enumerate(text):
        _write(sheet, line_, (whole.shape[1] + 12, _BANNER + _ZOOMED + 22 + 24 * k), colour)
    return sheet


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
    grey: Image, corner: tuple[float, float], factor: float, size: tuple[int, int]
) -> Image:
    """Return the part of `grey` from `corner` on, `factor` times as large, in colour channels."""
    into = np.array([
        [factor, 0.0, (0.5 - corner[0]) * factor - 0.5],
        [0.0, factor, (0.5 - corner[1]) * factor - 0.5],
    ])  # fmt: skip
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.4 / factor) if factor < 0.9 else grey
    part = cv2.warpAffine(smooth, into, size, flags=cv2.INTER_LINEAR if factor < 2 else 0)
    return np.asarray(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _draw(
    picture: Image,
    line: Array,
    corner: tuple[float, float],
    factor: float,
    colour: _Colour,
    thickness: int = 1,
) -> None:
    points = (line - corner + 0.5) * factor - 0.5
    fixed = np.round(points * (1 << _SUB)).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(picture, [fixed], True, colour, thickness, cv2.LINE_AA, _SUB)


def _write(picture: Image, text: str, place: tuple[int, int], colour: _Colour) -> None:
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
