"""A measurement of the flap angle on the terminal: by windows, all together, and what to know."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from tombo_propeller.flap_video.measure import FlapMeasurement

_FAR = 20.0
"""Camera heights in tip radii above which perspective hides little."""


def print_beta(found: FlapMeasurement, notes: list[str], path: Path | None) -> None:
    """Print angles with their intervals, the scale, and notes."""
    from rich.table import Table

    from tombo_bringup.cli.tables import console, right

    units = {"time": "s", "speed": "rpm", "rim": "px", "disc": "mm", "paper's formula": "deg"}
    columns = right(*(f"{name}\n[dim]{unit}[/dim]" for name, unit in units.items()))
    table = Table(*columns, "beta", title="Flap angle, by windows")
    step = max(1, math.ceil(len(found.windows) / 20))
    for w in found.windows[::step]:
        paper = "-" if math.isnan(w.paper) else f"{math.degrees(w.paper):.1f}"
        table.add_row(
            f"{w.time:.4f}", f"{w.speed * 30.0 / math.pi:.0f}", f"{w.rim.radius:.2f}",
            f"{w.radius * 1e3:.2f}", paper, w.angle.as_text(),
        )  # fmt: skip
    console().print(table)
    if found.steady:
        typer.echo(f"All {len(found.windows)} windows: {found.overall.as_text()}")
    typer.echo(
        f"Scale {found.scale.pixels_per_m * 1e-3:.4f} px/mm +- {100 * found.scale.error:.3f} % "
        f"({found.scale.source})"
    )
    for note in notes:
        typer.echo(f"Note: {note}.")
    if path is not None:
        typer.echo(f"Results: {path.resolve()}")


def notes_of(found: FlapMeasurement) -> list[str]:
    """Return what a reader of the angle has to know."""
    from tombo_propeller.flap_video.camera_geometry import CameraPose, ambiguous_angle_limit, angle

    notes = []
    span, view = found.span, found.view
    if math.isinf(view.height):
        seen = angle(found.radius, found.radius_sd, span, CameraPose(1.0, view.towards))
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
    if not found.scale.relative:
        notes.append(
            "the scale is absolute: tip shape and scale limit small angles; frames of the same "
            "propeller at low speed (--reference) do not have that error"
        )
    rim = found.windows[0].rim
    if math.hypot(*rim.oval) > 4.0 * rim.oval_sd and math.degrees(rim.tilt) > 2.0:
        how = "in the reference too: it cancels" if found.scale.relative else "taken out"
        notes.append(f"the camera is tilted by {math.degrees(rim.tilt):.1f} deg, {how}")
    if not found.steady:
        notes.append("the angle changes over the film: see the windows")
    if found.overall.inconsistent:
        notes.append(
            f"the disc has {found.radius * 1e3:.2f} mm, more than any flap gives: check scale, "
            "camera height and --from-below"
        )
    if found.skipped:
        notes.append(f"{len(found.skipped)} windows left out; {found.skipped[0]}")
    return notes
