"""The drive of a rotor that takes commands from 0 to 1: thrust from command and supply."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.params import param


@dataclass(frozen=True)
class DriveParams:
    """Thrust of one rotor: (offset + gain · command) · (voltage / supply)^supply_exponent."""

    gain: float = param(
        0.0, "N", (0.0, 1000.0), "thrust of one rotor per command from 0 to 1; 0: not known"
    )
    offset: float = param(0.0, "N", (-1000.0, 1000.0), "thrust of one rotor at command 0")
    supply_exponent: float = param(
        0.0, "1", (-4.0, 4.0), "how thrust grows with the voltage; 0: it is compensated"
    )
    supply: float = param(1.0, "V", (0.1, 1000.0), "voltage at which gain and offset hold")

    @property
    def known(self) -> bool:
        """Whether it says anything."""
        return self.gain > 0.0

    def thrust(self, command: Array, voltage: Array | None = None) -> Array:
        """Return the thrust [N] of each rotor, never below 0.

        Args:
            command: (N, 4) from 0 to 1.
            voltage: (N,) [V]; None: as at `supply`.
        """
        thrust = self.offset + self.gain * np.asarray(command)
        if voltage is not None and self.supply_exponent:
            thrust = thrust * ((voltage / self.supply) ** self.supply_exponent)[:, None]
        return np.asarray(np.maximum(thrust, 0.0))
