"""The columns of a sweep's table: names, types and units, the same whatever was flown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow as pa

    from tombo_flight.sweep.design import Design

FIGURES: Mapping[str, str] = {
    **dict.fromkeys(("scenario", "law", "reaction", "contact_rotor", "struck_rotor"), "text"),
    "ends_elsewhere": "text",
    **dict.fromkeys(
        ("disturbances", "collided", "detected", "crashed", "landed", "interrupted"), "yes or no"
    ),
    **dict.fromkeys(("conf", "detections", "false_alarms", "strikes", "rotors_broken"), "count"),
    **dict.fromkeys(("contact_point_m", "contact_position_m", "x_c_m", "n_r", "x_r_m"), "vector"),
    **dict.fromkeys(
        (
            *(
                "collision_time_s",
                "detection_time_s",
                "detection_latency_s",
                "contact_known_s",
                "crash_time_s",
            ),
            *("detection_confidence", "max_falling_distance_m", "unstable_phase_s"),
            *("recovery_time_s", "settled_error_m", "max_tilt_rad", "duration_s"),
            *("hover_rms_m", "approach_rms_m", "peak_contact_force_n"),
            *("wall_time_s", "real_time_factor"),
        ),
        "number",
    ),
}
"""Figures of a summary (docs/figures.md) → kind of their column."""
LEFT_OUT = ("tombo_version", "model", "seed", "recorded_messages")
"""Keys of a summary that are the same for all flights, or stand in columns of their own."""
WALL_COLUMNS = ("wall_time_s", "real_time_factor")
"""What differs between two sweeps of the same study."""
_UNITS = {"rad": "rad", "m": "m", "s": "s", "n": "N"}
"""Ending of a figure's name → unit."""
_AXES = ("x", "y", "z")


def row_of(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of a summary; a vector has one for each of x, y and z."""
    row: dict[str, Any] = {}
    for name, kind in FIGURES.items():
        value = summary[name]
        if kind == "vector":
            parts = (None, None, None) if value is None else value
            row |= {f"{name}_{a}": part for a, part in zip(_AXES, parts, strict=True)}
        else:
            row[name] = value
    return row


def unit_of(name: str) -> str:
    """Return the unit that the name of a figure ends with; empty: it has none."""
    return _UNITS.get(name.rpartition("_")[2], "")


def schema_of(design: Design, study: Mapping[str, Any]) -> pa.Schema:
    """Return the schema of the table, with units, and the whole study in its metadata."""
    import json

    import pyarrow as pa

    kinds = {
        "text": pa.string(), "yes or no": pa.bool_(), "count": pa.int64(), "number": pa.float64(),
    }  # fmt: skip
    fields = [pa.field(name, pa.int64()) for name in ("flight", "point", "seed")]
    for axis in design.axes:
        fields.append(pa.field(axis.key, pa.float64() if axis.numeric else pa.string()))
    for name, kind in FIGURES.items():
        names = [f"{name}_{a}" for a in _AXES] if kind == "vector" else [name]
        described = {"unit": unit_of(name)} if unit_of(name) else None
        fields += [pa.field(n, kinds.get(kind, pa.float64()), metadata=described) for n in names]
    fields.append(pa.field("error", pa.string()))
    text = json.dumps(study, ensure_ascii=False)
    return pa.schema(fields, metadata={"tombo": text})


def table_of(rows: Sequence[Mapping[str, Any]], design: Design, schema: pa.Schema) -> pa.Table:
    """Return rows as a table; axes of numbers become numbers, what a row lacks is null."""
    import pyarrow as pa

    numeric = {axis.key for axis in design.axes if axis.numeric}
    columns = {}
    for column in schema:
        values = [row.get(column.name) for row in rows]
        if column.name in numeric:
            values = [float(value) for value in values if value is not None]
        columns[column.name] = pa.array(values, column.type)
    return pa.table(columns, schema=schema)
