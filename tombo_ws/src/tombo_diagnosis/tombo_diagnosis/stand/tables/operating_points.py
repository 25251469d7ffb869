"""Stand runs as operating points: set-up, readings and their noise."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, Setup
from tombo_logs.checks.spans import Mask

UNITS = dict(zip(CHANNELS, ("N", "N m", "rad", "rad/s"), strict=True))


@dataclass(frozen=True, eq=False)
class OperatingPoints:
    """All operating points of a diagnosis."""

    setup: Setup
    readings: Array
    """(N, 4) in the order of CHANNELS; NaN: not measured."""
    sigma: Array
    """(N, 4) standard deviation of each reading by noise alone."""
    runs: tuple[str, ...]
    """Names of the runs."""
    propellers: tuple[str, ...]
    """Names of the propellers."""

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.setup.speed.size)

    @property
    def measured(self) -> tuple[int, ...]:
        """Places in CHANNELS of the channels with a reading."""
        return tuple(c for c in range(len(CHANNELS)) if np.isfinite(self.readings[:, c]).any())

    def blocks(self) -> list[Mask]:
        """Return the blocks held out in turn: configurations, else runs, else fifths of speed."""
        setup = self.setup
        if len(self.propellers) > 2:
            return [setup.propeller == k for k in range(len(self.propellers))]
        if len(self.runs) > 2:
            return [setup.run == k for k in range(len(self.runs))]
        order = np.argsort(np.argsort(setup.speed, kind="stable"), kind="stable")
        number = np.minimum(order * 5 // max(setup.speed.size, 1), 4)
        return [number == k for k in np.unique(number)]

    def only(self, keep: Mask) -> OperatingPoints:
        """Return some of the points; propellers and runs keep their numbers."""
        arrays = {f.name: getattr(self.setup, f.name) for f in fields(self.setup)}
        chosen: dict[str, Any] = {
            k: v[keep] for k, v in arrays.items() if isinstance(v, np.ndarray) and v.size
        }
        return replace(
            self,
            setup=replace(self.setup, **chosen),
            readings=self.readings[keep],
            sigma=self.sigma[keep],
        )
