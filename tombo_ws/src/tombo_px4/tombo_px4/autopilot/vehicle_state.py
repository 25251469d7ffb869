"""States of the simulated vehicle: what denies arming, battery, take-off, ground contact."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from tombo_dynamics.plant import Plant
from tombo_px4.autopilot.parameters import ParameterTable


class ArmingHealth(NamedTuple):
    """Reasons that deny arming, as texts for the operator, and what is known."""

    problems: tuple[str, ...]
    """Empty: it may be armed in the present mode."""
    attitude: bool
    local_position: bool
    global_position: bool

    @property
    def armable(self) -> bool:
        """Whether arming is allowed in the current mode."""
        return not self.problems


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


class TakeoffState(IntEnum):
    """State of a take-off (PX4 `takeoff_status`)."""

    DISARMED = 1
    SPOOLUP = 2
    READY = 3
    RAMPUP = 4
    FLIGHT = 5


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
_LOW = 0.8
"""Share of the hover thrust at which a vehicle that does not sink is held up by the ground."""
_VERY_LOW = 0.3
_HELD = 0.97


class GroundMotion(NamedTuple):
    """Inputs of the land detector."""

    armed: bool
    airborne: bool
    """A take-off has begun."""
    begins: bool
    """The thrust of a take-off rises, and does not lift it yet."""
    position_known: bool
    height_known: bool
    descending: bool
    """The set point sinks."""
    climb: float
    """Estimated vertical speed [m/s]."""
    slide: float
    """Estimated horizontal speed [m/s]."""
    turn: float
    """Body rate [rad/s]."""
    force: float
    """Length of the specific force over gravity, smoothed."""
    thrust: float
    """Collective thrust asked for over the weight."""


class LandDetector:
    """Ground contact, then maybe landed, then landed; one call a tick of 20 ms."""

    def __init__(self) -> None:
        self._contact = 0
        self.landed = True

    @property
    def contact(self) -> bool:
        """It touches the ground: the thrust may fall."""
        return self.landed or self._contact >= _CONTACT_TICKS

    @property
    def maybe_landed(self) -> bool:
        """It very likely stands: it may be disarmed."""
        return self.landed or self._contact >= _CONTACT_TICKS + _MAYBE_TICKS

    def update(self, motion: GroundMotion, climb_max: float, slide_max: float, ticks: int) -> None:
        """Look at the motion of the last `ticks` ticks."""
        if motion.armed and motion.begins and not motion.airborne:
            self.landed = False
            self._contact = 0
            return
        if not motion.armed or not motion.airborne:
            self.landed = True
            self._contact = 0
            return
        if self._stands(motion, climb_max, slide_max):
            self._contact += ticks
        else:
            self._contact = 0
        self.landed = self._contact >= _CONTACT_TICKS + _MAYBE_TICKS + _LANDED_TICKS

    def _stands(self, motion: GroundMotion, climb_max: float, slide_max: float) -> bool:
        quiet = motion.turn < math.radians(20.0) and abs(motion.force - 1.0) < 0.15
        if motion.position_known:
            quiet = quiet and abs(motion.climb) < climb_max and motion.slide < slide_max
            low = _LOW if motion.descending or self._contact > 0 else _VERY_LOW
            return quiet and motion.thrust < low
        if not motion.height_known:  # PX4 sees no vertical motion, nor that there is none
            return False
        # level and descending, it is held up by less than its weight until the ground does it
        return quiet and motion.force > _HELD
