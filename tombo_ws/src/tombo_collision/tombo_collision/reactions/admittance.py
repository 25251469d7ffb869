"""Give way as a virtual mass on a damped spring does, the reaction that the paper names next."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tombo_collision.decision import Estimate, Guided
from tombo_collision.reactions import OffSurface
from tombo_dynamics.arrays import Array
from tombo_dynamics.params import param


@dataclass(frozen=True)
class Admittance(OffSurface):
    """The reference is the motion of a mass that the strike pushes off x_c.

    It starts at x_c with the velocity that the strike leaves the vehicle. A damped spring takes it
    to its point of rest: not x_c itself, where the obstacle is, but x_r = x_c + d_r n_r. Flown
    with the cascade's own gains.
    """

    name: ClassVar[str] = "admittance"

    mass: float = param(1.3, "kg", (0.1, 20.0), "virtual mass", "the vehicle's own")
    stiffness: float = param(
        5.2, "N/m", (0.1, 200.0), "of the spring to x_r", "2 rad/s with the mass: tilt below 0.33"
    )
    damping: float = param(
        5.2, "N s/m", (0.1, 200.0), "of the damper", "critical: 2 sqrt(stiffness mass)"
    )
    timeout: float = param(
        6.0, "s", (0.5, 60.0), "after this time the mission holds x_r", "twice the motion's time"
    )

    def way(self, decision: Guided, estimate: Estimate) -> Guided:
        """Return the motion from x_c to x_r."""
        return _Motion(
            **vars(decision),
            start_velocity=estimate.velocity,
            frequency=math.sqrt(self.stiffness / self.mass),
            ratio=0.5 * self.damping / math.sqrt(self.stiffness * self.mass),
        )


@dataclass
class _Motion(Guided):
    start_velocity: Array
    """(3) [m/s]."""
    frequency: float
    """Natural, undamped [rad/s]."""
    ratio: float
    """Of damping to the critical one."""

    def motion(self, time_s: float, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Return the mass's motion: m x'' + d x' + k (x - x_r) = 0 from x_c on."""
        w, off, v = self.frequency, self.x_c - self.x_r, self.start_velocity
        root = np.sqrt(complex(self.ratio**2 - 1.0))
        if abs(root) < 1e-3:
            root = 1e-3 + 0.0j  # the two poles apart by little: the limit, to 1e-6
        p, q = w * (-self.ratio + root), w * (-self.ratio - root)
        a = (v - q * off) / (p - q)
        b = off - a
        parts = [
            (a * p**k * np.exp(p * time_s) + b * q**k * np.exp(q * time_s)).real for k in range(3)
        ]
        return self.x_r + parts[0], parts[1], parts[2]
