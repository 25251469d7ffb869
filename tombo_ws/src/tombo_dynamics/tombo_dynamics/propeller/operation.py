"""Operating points: what a propeller does at a speed."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

RPM = math.pi / 30.0
"""One revolution per minute [rad/s]: 2000 * RPM is what `speed_rad_s` takes."""


@dataclass(frozen=True, eq=False)
class Operation:
    """Operating points; every array has the shape that was asked for."""

    speed_rad_s: Array
    thrust_N: Array
    drag_N: Array
    torque_Nm: Array
    """Not validated: the coefficients know no inflow, so it may be 2 to 3 times too high."""
    alpha_rad: Array
    """Lag of the wing: rotation of the nodus in the disc's plane."""
    beta_rad: Array
    """Flap: out of the disc's plane, upwards."""
    gamma_rad: Array
    """Twist about the span, nose down."""
    lift_over_drag: Array
    valid: NDArray[np.bool_]
    verdict: NDArray[np.int64]
    """0 valid, 1 twisted beyond the coefficients' range, 2 no equilibrium."""

    @property
    def speed_rpm(self) -> Array:
        """Rotor speed [rpm], for tables and figures."""
        return self.speed_rad_s / RPM

    @property
    def power_W(self) -> Array:
        """Shaft power [W], torque times speed; as little validated as the torque is."""
        return self.torque_Nm * self.speed_rad_s

    def __len__(self) -> int:
        """Return the number of points."""
        return self.speed_rad_s.size

    def __repr__(self) -> str:
        """Say what there is, not every number."""
        shape = " x ".join(map(str, self.speed_rad_s.shape)) or "one point"
        return f"{type(self).__name__}({shape}, {int(self.valid.sum())} of {len(self)} valid)"

    def table(self, **columns: ArrayLike) -> dict[str, NDArray[np.generic]]:
        """Return the points as columns (n,), e.g. for pandas.DataFrame.

        Args:
            **columns: more columns to begin with, e.g. what was varied; broadcast with the points.

        Raises:
            InputError: a column that does not broadcast, or that is there already.
        """
        found: dict[str, NDArray[np.generic]] = {}
        own = {f.name: getattr(self, f.name) for f in fields(Operation)}
        shape = self.speed_rad_s.shape
        for name, values in columns.items():
            if name in own:
                raise InputError(f"column {name} is there already; accepted: other names")
            try:
                found[name] = np.broadcast_to(np.asarray(values), shape).ravel()
            except ValueError:
                raise InputError(
                    f"column {name} of shape {np.shape(values)}; accepted: what broadcasts to "
                    f"{shape}"
                ) from None
        return found | {name: values.ravel() for name, values in own.items()}

    def csv(self, **columns: ArrayLike) -> str:
        """Return the table as CSV text with a head line, e.g. for `Path.write_text`.

        Numbers with all their digits, speed in rpm as well, empty where there is no result.
        """
        table = self.table(**columns)
        before = list(table).index("speed_rad_s")
        names = list(table)
        names.insert(before, "speed_rpm")
        return csv_text({name: self.speed_rpm.ravel() if name == "speed_rpm" else table[name]
                         for name in names})  # fmt: skip


def csv_text(table: Mapping[str, NDArray[np.generic]]) -> str:
    """Return columns as CSV text; NaN is empty, truth is true or false."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(map(_cell, column.tolist()) for column in table.values()), strict=True))
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return value
