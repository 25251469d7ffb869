"""Parameters of the simulator link to a real PX4: its rate and its messages."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.errors import InputError
from tombo_dynamics.params import param, validate
from tombo_dynamics.time_base import TICK_HZ
from tombo_px4.link.link_params import plain


@dataclass(frozen=True)
class HilParams:
    """Messages that PX4 receives, and their rates."""

    rate: float = param(
        250.0,
        "Hz",
        (250.0, 1000.0),
        "HIL_SENSOR messages: 250, 333, 500 or 1000; PX4's IMU_INTEG_RATE must be the same",
        "PX4's: 250",
    )
    gps: bool = plain(True, "send HIL_GPS")

    @property
    def ticks(self) -> int:
        """Ticks of 1 ms between two HIL_SENSOR."""
        return round(TICK_HZ / self.rate)

    def check(self) -> HilParams:
        """Return the record if it can be used.

        Raises:
            InputError: out of bounds, or no whole number of ms.
        """
        validate(self, "hil")
        if abs(self.rate * self.ticks - TICK_HZ) > 2.0:
            raise InputError(
                f"hil.rate: {self.rate:g} Hz is no whole number of ms; accepted: 250, 333, 500 or "
                "1000 [Hz]"
            )
        return self
