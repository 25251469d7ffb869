"""What `tombo propeller beta` and `recovery` write: JSON, tables, pictures."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tombo_dynamics.propeller import RPM

if TYPE_CHECKING:
    from tombo_propeller.flap_video.camera_geometry import FlapAngle
    from tombo_propeller.flap_video.measure import FlapMeasurement, VideoWindow
    from tombo_propeller.flap_video.trace import RotorTrace
    from tombo_propeller.recovery import ThrustRecovery

BETA_FILES = ("beta.json", "beta.csv", "beta.png", "overlay.png")
RECOVERY_FILES = ("recovery.json", "recovery.csv", "recovery.png")
_COLUMNS = ("time_s", "rpm", "beta_deg", "beta_low_deg", "beta_high_deg", "radius_px",
            "radius_sd_px", "radius_mm", "hull_radius_px", "paper_beta_deg", "words")  # fmt: skip


def beta_json(found: FlapMeasurement, notes: list[str]) -> str:
    """Return the measurement as JSON; angles in degrees, null where none can be named."""
    scale, view = found.scale, found.view
    rest = {
        "beta": _angle(found.overall) if found.steady else None,
        "steady": found.steady,
        "windows": [_window(w) for w in found.windows],
        "skipped": list(found.skipped),
        "scale": {
            "px_per_mm": scale.pixels_per_m * 1e-3,
            "error_share": scale.error,
            "source": scale.source,
        },
        "camera": {
            "height_mm": None if math.isinf(view.height) else view.height * 1e3,
            "blades_flap_towards_it": view.towards,
            "tilt_deg": math.degrees(found.windows[0].rim.tilt),
        },
        "blade": {"tip_mm": found.span.tip * 1e3, "nodus_mm": found.span.nodus * 1e3},
        "notes": notes,
    }
    return json.dumps(rest, indent=1, allow_nan=False) + "\n"


def beta_csv(found: FlapMeasurement) -> str:
    """Return a line a window; beta_deg is empty where the diameter does not resolve it."""
    return _table(_COLUMNS, [_row(w) for w in found.windows])


def _angle(a: FlapAngle) -> dict[str, Any]:
    return {
        "deg": math.degrees(a.best) if a.resolved and not a.inconsistent else None,
        "low_deg": math.degrees(a.low),
        "high_deg": math.degrees(a.high),
        "pieces_deg": [[math.degrees(x) for x in piece] for piece in a.pieces],
        "words": a.as_text(),
    }


def _window(w: VideoWindow) -> dict[str, Any]:
    return {
        "first_frame": w.first,
        "frames": w.frames,
        "time_s": w.time,
        "rpm": _finite(w.speed / RPM),
        "beta": _angle(w.angle),
        "radius_px": w.rim.radius,
        "radius_sd_px": w.rim.sd,
        "radius_mm": w.radius * 1e3,
        "hull_radius_px": w.disc.radius,
        "paper_beta_deg": _finite(math.degrees(w.paper)),
    }


def _row(w: VideoWindow) -> list[Any]:
    a = w.angle
    best = math.degrees(a.best) if a.resolved and not a.inconsistent else None
    return [
        round(w.time, 6), _rounded(w.speed / RPM, 1), _rounded(best, 3),
        round(math.degrees(a.low), 3), round(math.degrees(a.high), 3), round(w.rim.radius, 3),
        round(w.rim.sd, 4), round(w.radius * 1e3, 4), round(w.disc.radius, 2),
        _rounded(math.degrees(w.paper), 2), a.as_text(),
    ]  # fmt: skip


def recovery_json(found: tuple[ThrustRecovery, ...], trace: RotorTrace, share: float) -> str:
    """Return the collisions as JSON; levels in the trace's own unit.

    A speed trace's recovery is a lower bound: while a blade is folded, thrust is less than speed
    says.
    """
    rows = [
        {
            "time_s": r.time,
            "level": r.level,
            "lowest": r.lowest,
            "recovery_s": _finite(r.recovered),
            "low_s": r.low,
            "high_s": _finite(r.high),
            "words": r.as_text(lower_bound=trace.is_speed),
        }
        for r in found
    ]
    whole = {
        "trace": trace.column,
        "kind": trace.kind,
        "unit": trace.unit,
        "lower_bound": trace.is_speed,
        "recovered_at_share": share,
        "collisions": rows,
    }
    return json.dumps(whole, indent=1, allow_nan=False) + "\n"


def recovery_csv(found: tuple[ThrustRecovery, ...], trace: RotorTrace) -> str:
    """Return a line a collision; levels in the trace's own unit."""
    return _table(
        ("time_s", "level", "lowest", "unit", "recovery_s", "low_s", "high_s", "words"),
        [
            [round(r.time, 6), r.level, r.lowest, trace.unit, _rounded(r.recovered, 5),
             round(r.low, 5), _rounded(r.high, 5), r.as_text(lower_bound=trace.is_speed)]
            for r in found
        ],
    )  # fmt: skip


def write_text(path: Path, text: str) -> None:
    """Write a file."""
    path.write_text(text, encoding="utf-8")


def _table(columns: tuple[str, ...], rows: list[list[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rounded(value: float | None, digits: int) -> float | str:
    return "" if value is None or not math.isfinite(value) else round(value, digits)
