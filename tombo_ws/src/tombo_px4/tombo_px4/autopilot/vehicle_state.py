"""States of the simulated vehicle: battery, take-off, ground contact."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from tombo_dynamics.plant import Plant
from tombo_px4.autopilot.parameters import ParameterTable


class TakeoffState(IntEnum):
    """State of a take-off (PX4 `takeoff_status`)."""

    DISARMED = 1
    SPOOLUP = 2
    READY = 3
    RAMPUP = 4
    FLIGHT = 5


class BatteryCharge(NamedTuple):
    """State of the battery."""

    voltage: float
    """[V]."""
    current: float
    """Drawn [A]."""
    remaining: float
    """Share of the charge, 1: full."""
    warning: int
    """0 none, 1 low, 2 critical, 3 emergency."""


_EFFICIENCY = 0.7
"""Of drives and motors, as in the effect `battery_sag`."""
_LEVELS = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")


class BatteryMeter:
    """Counts the charge of one pack, full at first; `voltage` [V] is that of the full pack."""

    def __init__(self, voltage: float, parameters: ParameterTable) -> None:
        self._voltage = voltage
        self._parameters = parameters
        self._used_mah = 0.0

    def draw(self, plant: Plant, seconds: float) -> BatteryCharge:
        """Count what the plant has drawn; without a battery in it, from power and voltage."""
        voltage, current = float(plant.supply.voltage), float(plant.supply.current)
        if voltage <= 0.0 or current <= 0.0:
            voltage = self._voltage
            power = float(plant.rotor_torque @ plant.rotor_speed)
            current = power / (_EFFICIENCY * voltage)
        self._used_mah += current * seconds / 3.6
        get = self._parameters.get
        capacity = get("BAT1_CAPACITY")
        remaining = 1.0 if capacity <= 0.0 else max(1.0 - self._used_mah / capacity, 0.0)
        warning = sum(remaining < get(name) for name in _LEVELS)
        return BatteryCharge(voltage, current, remaining, warning)


_CONTACT_TICKS, _MAYBE_TICKS, _LANDED_TICKS = 350, 250, 300


class LandDetector:
    """Ground contact, then maybe landed, then landed."""

    def __init__(self) -> None:
        self.contact_ticks = 0
        """It has looked like standing for so long."""
        self.landed = True

    @property
    def contact(self) -> bool:
        """It touches the ground: the thrust may fall."""
        return self.landed or self.contact_ticks >= _CONTACT_TICKS

    @property
    def maybe_landed(self) -> bool:
        """It very likely stands: it may be disarmed."""
        return self.landed or self.contact_ticks >= _CONTACT_TICKS + _MAYBE_TICKS

    def stay(self, landed: bool) -> None:
        """Say that it is on the ground, or leaves it, whatever its motion looks like."""
        self.landed, self.contact_ticks = landed, 0

    def update(self, stands: bool, ticks: int) -> None:
        """Count whether it looks like standing, in the last `ticks` ticks of a flight."""
        self.contact_ticks = self.contact_ticks + ticks if stands else 0
        self.landed = self.contact_ticks >= _CONTACT_TICKS + _MAYBE_TICKS + _LANDED_TICKS
