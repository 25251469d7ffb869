"""Runs of a thrust stand as operating points: the conditions set, the readings and their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, Setup
from tombo_logs.checks.spans import Mask

UNITS = dict(zip(CHANNELS, ("N", "N m", "rad", "rad/s"), strict=True))
"""Channel → unit; beta is the flap angle."""


@dataclass(frozen=True, eq=False)
class OperatingPoints:
    """All N operating points of a diagnosis."""

    setup: Setup
    """Speed, propeller and run of each point, and known loads."""
    readings: Array
    """(N, 4) in the order of CHANNELS, with their UNITS; NaN: not measured."""
    sigma: Array
    """(N, 4) standard deviation of each reading by noise alone, with the same units."""
    runs: tuple[str, ...]
    """Name of each run; `setup.run` has places in it."""
    propellers: tuple[str, ...]
    """Name of each propeller; `setup.propeller` has places in it."""

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.setup.speed.size)

    @property
    def measured(self) -> tuple[int, ...]:
        """Places in CHANNELS of the channels with a reading."""
        return tuple(c for c in range(len(CHANNELS)) if np.isfinite(self.readings[:, c]).any())

    def blocks(self) -> list[Mask]:
        """Return the blocks (N,) of a cross-validation, each left out of a fit in turn.

        These are propellers if there are three or more, else runs if three or more, else fifths of
        the points by speed.
        """
        setup = self.setup
        if len(self.propellers) > 2:
            return [setup.propeller == k for k in range(len(self.propellers))]
        if len(self.runs) > 2:
            return [setup.run == k for k in range(len(self.runs))]
        rank = np.argsort(np.argsort(setup.speed, kind="stable"), kind="stable")
        fifth = np.minimum(rank * 5 // max(setup.speed.size, 1), 4)
        return [fifth == k for k in np.unique(fifth)]

    def only(self, keep: Mask) -> OperatingPoints:
        """Return the points where `keep` (N,) is true; propellers and runs keep their numbers."""
        arrays = {k: v for k, v in vars(self.setup).items() if isinstance(v, np.ndarray)}
        chosen: dict[str, Any] = {k: v[keep] for k, v in arrays.items() if v.size}
        return replace(
            self,
            setup=replace(self.setup, **chosen),
            readings=self.readings[keep],
            sigma=self.sigma[keep],
        )
