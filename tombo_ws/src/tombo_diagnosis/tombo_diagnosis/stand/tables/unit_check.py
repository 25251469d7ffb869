"""Check of the units of thrust and speed by comparison with the model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import predict
from tombo_dynamics.vehicle import GRAVITY

_RATIO = 3.0
"""Times the model's thrust, or its inverse, that no propeller of the paper shows."""
_NEAR = 1.6
_TIMES = {
    "grams read as newtons": 1e3 / GRAVITY,
    "rad/s read as rpm": RPM**-2,
    "rpm read as rad/s": RPM**2,
    "Hz read as rpm": 3600.0,
    "millinewtons read as newtons": 1e3,
    "kilograms read as newtons": 1.0 / GRAVITY,
    "four rotors on one cell (`rotors: 4` in --mapping)": 4.0,
}
"""Mistake of units -> factor by which thrust at equal speed is then too large."""


def check_scale(
    points: OperatingPoints, tables: Sequence[StandTable], sizes: Sequence[int]
) -> None:
    """Refuse a thrust that is nowhere near the model's.

    `points` are those of all tables, one after the other; `sizes` are how many points each has.

    Raises:
        InputError: a table's thrust is three times the model's or a third of it; names column,
            factor and the slips that would do it.
    """
    model = predict(points.setup, {})[:, 0]
    ends = np.cumsum([0, *sizes])
    for table, low, high in zip(tables, ends[:-1], ends[1:], strict=True):
        speed, y = points.setup.speed[low:high], points.readings[low:high, 0]
        fast = np.isfinite(y) & np.isfinite(model[low:high]) & (speed > 0.0)
        fast &= speed > 0.5 * float(speed[fast].max(initial=0.0))
        if not fast.any():
            continue
        times = float(np.median(y[fast] / model[low:high][fast]))
        if any(1.0 / _RATIO < t < _RATIO for t in (times, _rise(y, model[low:high], times))):
            continue
        slips = [
            name
            for name, size in _TIMES.items()
            if times > 0.0 and abs(math.log(times / size)) < math.log(_NEAR)
        ]
        guess = f"as with {' or '.join(slips)}" if slips else "another propeller? (--plain)"
        where = table.mapping.channels["thrust"]
        raise InputError(
            f"{table.source}: column '{where.columns[0]}' as {where.unit} is {times:.3g} times "
            f"the model's thrust, {guess}; accepted: {1.0 / _RATIO:.2g} to {_RATIO:g} times"
        )


def _rise(y: Array, model: Array, times: float) -> float:
    """Return how many times the model's rise with speed a thrust y has; the zero may be off.

    Both are (N,) [N]; `times` is returned where thrust hardly changes.
    """
    known = np.isfinite(y) & np.isfinite(model)
    x = model[known]
    if x.size < 3 or np.ptp(x) < 0.5 * float(np.abs(x).max()):
        return times
    return float(np.polyfit(x, y[known], 1)[0])
