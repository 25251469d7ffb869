"""A blade from a table of chord and twist, or a known blade in another size.

A table says nothing of joint, mass and thickness. They are taken from a known blade: thickness
over chord as there at the same share of the radius. So the joint's section goes with the square
of the chord, its second moments with the fourth power, mass with volume. Offsets stay, as angles.
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.params import check_number
from tombo_dynamics.propeller import Blade, Joint
from tombo_dynamics.propeller.blade import shape, volume_moments
from tombo_dynamics.propeller.records import BladeSegment

LARGEST_TABLE: Final = 65_536
"""Characters of a table."""
DIAMETER_MM: Final = (40.0, 1000.0)
_ROWS: Final = (4, 200)
_INNERMOST, _OUTERMOST = 0.3, 0.9
"""Shares of the tip radius that a table has to begin within, and to reach."""
_LARGEST_NUMBER: Final = 1e6
_CHORD_SHARE: Final = (0.005, 1.0)
_TWIST_DEG: Final = (-9.0, 80.0)
_HEADS: Final = {
    ("r_mm", "chord_mm", "twist_deg"): 1e-3,
    ("r_m", "chord_m", "twist_deg"): 1.0,
    ("r/r", "c/r", "beta"): None,
}
"""Names of the columns, in lower case → metres of a unit; None: shares of the tip radius."""
_ACCEPTED: Final = (
    "accepted: columns r_mm, chord_mm, twist_deg (or r_m, chord_m, twist_deg, or r/R, c/R, beta), "
    f"{_ROWS[0]} to {_ROWS[1]} rows from the hub to the tip"
)


@dataclass(frozen=True, eq=False)
class BladeTable:
    """Chord and twist along the span."""

    radius_m: Array
    """(n,) from the hub's centre, rising."""
    chord_m: Array
    twist_deg: Array
    tip_radius_m: float


def parse_blade_table(text: str, diameter_mm: float | None = None) -> BladeTable:
    """Read a table: comma, semicolon, tab or space between columns, `#` before a remark.

    Args:
        text: the table; without a line of names its columns are r_mm, chord_mm, twist_deg.
        diameter_mm: of the propeller; needed for shares of the radius, else twice the last radius.

    Raises:
        InputError: no such table, or one that is no blade.
    """
    if len(text) > LARGEST_TABLE:
        raise InputError(f"table: too large; accepted: up to {LARGEST_TABLE} characters")
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    rows = [[c for c in re.split(r"[,;\s]+", line) if c] for line in lines if line]
    unit: float | None = 1e-3
    if rows and not _is_number(rows[0][0]):
        head = tuple(name.lower() for name in rows.pop(0))
        if head not in _HEADS:
            raise InputError(f"table: columns {shown(', '.join(head))}; {_ACCEPTED}")
        unit = _HEADS[head]
    if not _ROWS[0] <= len(rows) <= _ROWS[1]:
        raise InputError(f"table: {len(rows)} rows; {_ACCEPTED}")
    values = np.array([_row(i, row) for i, row in enumerate(rows, 1)])
    if diameter_mm is not None:
        check_number("diameter_mm", diameter_mm, "mm", DIAMETER_MM)
    if unit is None:
        if diameter_mm is None:
            raise InputError("table: r/R without a diameter; accepted: with diameter_mm")
        unit = 0.5e-3 * diameter_mm
    radius, chord, twist = values[:, 0] * unit, values[:, 1] * unit, values[:, 2]
    tip = float(radius[-1]) if diameter_mm is None else 0.5e-3 * diameter_mm
    check_number("diameter of the table", 2e3 * tip, "mm", DIAMETER_MM)
    _check_shape(radius, chord, twist, tip)
    return BladeTable(radius, chord, twist, tip)


def blade_from_table(name: str, table: BladeTable, like: Blade) -> Blade:
    """Return a blade of a table; what a table does not say is scaled from a known blade.

    Between the stations chord times cos(twist) and twist are straight lines.

    Args:
        name: of the blade.
        table: its chord and twist.
        like: gives force coefficients, thickness over chord, joint and density.
    """
    depth = table.chord_m * np.cos(np.radians(table.twist_deg))
    x = table.radius_m
    pieces = tuple(
        BladeSegment(
            float(x[i]), float(x[i + 1]), _line(x, depth, i), _line(x, table.twist_deg, i)
        )
        for i in range(x.size - 1)
    )
    scale = table.tip_radius_m / like.tip_radius_m
    at = np.array(like.thickness_at_m)
    ratio = np.interp(at * scale, x, table.chord_m) / _chord(like, at)
    outer = round(like.joint.outer_radius_m * scale, 4)
    joint = dataclasses.replace(like.joint, outer_radius_m=outer)
    blade = Blade(
        name=name,
        pieces=pieces,
        section=like.section,
        joint=joint,
        tip_radius_m=table.tip_radius_m,
        thickness_at_m=tuple(float(v) for v in at * scale),
        thickness_mm=tuple(float(v) for v in np.array(like.thickness_mm) * ratio),
    )
    return dataclasses.replace(blade, joint=_joint_like(blade, like))


def scaled_blade(name: str, like: Blade, diameter_mm: float) -> Blade:
    """Return a known blade, every length of it in another size.

    Raises:
        InputError: the diameter is out of bounds.
    """
    check_number("diameter_mm", diameter_mm, "mm", DIAMETER_MM)
    scale = 0.5e-3 * diameter_mm / like.tip_radius_m

    def stretched(coefficients: tuple[float, ...], by: float) -> tuple[float, ...]:
        highest = len(coefficients) - 1
        return tuple(by * c * scale ** (i - highest) for i, c in enumerate(coefficients))

    return dataclasses.replace(
        like,
        name=name,
        pieces=tuple(
            BladeSegment(
                piece.start_m * scale,
                piece.end_m * scale,
                stretched(piece.depth_m, scale),
                stretched(piece.pitch_deg, 1.0),
            )
            for piece in like.pieces
        ),
        joint=_scaled_joint(like.joint, scale, scale, scale**3),
        published=None,
        tip_radius_m=like.tip_radius_m * scale,
        thickness_at_m=tuple(at * scale for at in like.thickness_at_m),
        thickness_mm=tuple(mm * scale for mm in like.thickness_mm),
    )


def _joint_like(blade: Blade, like: Blade) -> Joint:
    """Return the joint of a blade whose outer radius is set already."""
    scale = blade.tip_radius_m / like.tip_radius_m
    start, end = blade.pieces[0].start_m, blade.pieces[-1].end_m
    outer = blade.joint.outer_radius_m
    if not start < outer < end:
        raise InputError(
            f"table: begins at {1e3 * start:g} mm, outside of the joint at {1e3 * outer:.1f} mm; "
            "accepted: a table that begins nearer to the hub"
        )
    volume, centroid, _ = volume_moments(blade, outer, end)
    like_outer = like.joint.outer_radius_m
    like_volume, like_centroid, _ = volume_moments(like, like_outer, like.pieces[-1].end_m)
    wider = float(_chord(blade, np.array(outer)) / _chord(like, np.array(like_outer)))
    joint = _scaled_joint(like.joint, scale, wider, float(volume / like_volume))
    further = float(centroid / like_centroid)
    return dataclasses.replace(joint, wing_centroid_m=like.joint.wing_centroid_m * further)


def _scaled_joint(joint: Joint, longer: float, wider: float, heavier: float) -> Joint:
    return dataclasses.replace(
        joint,
        outer_radius_m=round(joint.outer_radius_m * longer, 4),  # to what can be made
        section_area_mm2=joint.section_area_mm2 * wider**2,
        flap_second_moment_mm4=joint.flap_second_moment_mm4 * wider**4,
        lag_second_moment_mm4=joint.lag_second_moment_mm4 * wider**4,
        torsion_constant_m4=joint.torsion_constant_m4 * wider**4,
        lift_arm_mm=joint.lift_arm_mm * wider,
        drag_arm_mm=joint.drag_arm_mm * wider,
        wing_mass_kg=joint.wing_mass_kg * heavier,
        wing_centroid_m=joint.wing_centroid_m * longer,
    )


def _chord(blade: Blade, x: Array) -> Array:
    depth, pitch = shape(blade, x)
    return np.asarray(depth / np.cos(pitch))


def _line(x: Array, y: Array, i: int) -> tuple[float, float]:
    slope = float((y[i + 1] - y[i]) / (x[i + 1] - x[i]))
    return slope, float(y[i]) - slope * float(x[i])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _row(number: int, cells: list[str]) -> list[float]:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != 3 or not all(abs(v) < _LARGEST_NUMBER for v in values):
        raise InputError(f"table: row {number} is {shown(' '.join(cells))}; {_ACCEPTED}")
    return values


def _check_shape(radius: Array, chord: Array, twist: Array, tip: float) -> None:
    """Refuse what is no blade.

    Raises:
        InputError: names the row and what is accepted.
    """

    def refuse(bad: Any, values: Array, what: str, accepted: str) -> None:
        if bad.any():
            i = int(np.argmax(bad))
            raise InputError(f"table: {what} {values[i]:.4g} in row {i + 1}; accepted: {accepted}")

    refuse(
        np.diff(radius, prepend=0.0) <= 0.0, 1e3 * radius, "radius [mm]", "above the row before"
    )
    refuse(radius > 1.001 * tip, 1e3 * radius, "radius [mm]", f"up to the tip, {1e3 * tip:.4g} mm")
    low, high = (share * tip for share in _CHORD_SHARE)
    refuse((chord < low) | (chord > high), 1e3 * chord, "chord [mm]",
           f"{1e3 * low:.3g} to {1e3 * high:.4g}")  # fmt: skip
    refuse((twist < _TWIST_DEG[0]) | (twist > _TWIST_DEG[1]), twist, "twist [deg]",
           f"{_TWIST_DEG[0]:g} to {_TWIST_DEG[1]:g}")  # fmt: skip
    first, last = radius[0] / tip, radius[-1] / tip
    if first > _INNERMOST or last < _OUTERMOST:
        raise InputError(
            f"table: from {first:.2f} to {last:.2f} of the tip radius; accepted: from "
            f"{_INNERMOST:g} or less to {_OUTERMOST:g} or more"
        )
