"""What is left in the battery: charge counted, voltage and current as the plant has them."""

from __future__ import annotations

from tombo_dynamics.plant import Plant
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.vehicle_state import Battery

_EFFICIENCY = 0.7
"""Of drives and motors, as in the effect `battery_sag`."""
_LEVELS = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")


class BatteryMeter:
    """Counts the charge of one pack."""

    def __init__(self, voltage: float, parameters: ParameterTable) -> None:
        """Begin full.

        Args:
            voltage: of the full pack [V].
            parameters: of the autopilot.
        """
        self._voltage = voltage
        self._parameters = parameters
        self._used_mah = 0.0

    def draw(self, plant: Plant, seconds: float) -> Battery:
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
        return Battery(voltage, current, remaining, warning)
