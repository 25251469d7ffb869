"""Arrays with names as pandas tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.vehicle import ROTOR_NAMES

if TYPE_CHECKING:
    import pandas as pd

_PARTS: Mapping[str, Sequence[str]] = {
    "contact": ("touching", "rotor", "x", "y", "z"),
    "battery": ("charge_used", "current", "voltage"),
}
_OF_ROTORS = ("rotor_speed", "rotor_thrust", "rotor_command", "motor_command", "fold", "damage")
_XYZW = ("x", "y", "z", "w")


def frame_of(columns: Mapping[str, Any], time_s: Any) -> pd.DataFrame:
    """Return a table over time: arrays (N,) and (N, k) by name, k columns "name.part" for each.

    Args:
        columns: name → array.
        time_s: (N,) the index [s].
    """
    import pandas as pd

    flat: dict[str, Any] = {}
    for name, values in columns.items():
        flat |= dict(_flat(name, np.asarray(values)))
    return pd.DataFrame(flat, index=pd.Index(np.asarray(time_s), name="t"))


def html_table(title: str, rows: Mapping[str, Any]) -> str:
    """Return names and values as HTML, for notebooks."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(_shown(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<b>{escape(title)}</b><table>{lines}</table>"


def _flat(name: str, values: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns (N,) of one array."""
    if values.dtype.names is not None:
        for part in values.dtype.names:
            yield from _flat(f"{name}.{part}", values[part])
    elif values.ndim == 1:
        yield name, values
    elif values.ndim == 2 and values.shape[1] == 1:
        yield name, values[:, 0]
    else:
        wide = np.ascontiguousarray(values.reshape(values.shape[0], -1).T)
        for part, column in zip(_parts(name, wide.shape[0]), wide, strict=True):
            yield f"{name}.{part}", column


def _parts(name: str, width: int) -> Sequence[str]:
    last = name.rpartition(".")[2]
    if last in _PARTS and len(_PARTS[last]) == width:
        return _PARTS[last]
    if last in _OF_ROTORS and width == len(ROTOR_NAMES):
        return ROTOR_NAMES
    return _XYZW[:width] if width in (3, 4) else [str(k) for k in range(width)]


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(_shown(part) for part in value) + ")"
    return str(value)
