"""Land detector: ground contact, maybe landed, landed, as in PX4."""

from __future__ import annotations

import math
from typing import NamedTuple

_CONTACT_TICKS, _MAYBE_TICKS, _LANDED_TICKS = 350, 250, 300
_LOW = 0.8
"""Share of the hover thrust at which a vehicle that does not sink is held up by the ground."""
_VERY_LOW = 0.3
_HELD = 0.97


class Motion(NamedTuple):
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

    def update(self, motion: Motion, climb_max: float, slide_max: float, ticks: int) -> None:
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

    def _stands(self, motion: Motion, climb_max: float, slide_max: float) -> bool:
        quiet = motion.turn < math.radians(20.0) and abs(motion.force - 1.0) < 0.15
        if motion.position_known:
            quiet = quiet and abs(motion.climb) < climb_max and motion.slide < slide_max
            low = _LOW if motion.descending or self._contact > 0 else _VERY_LOW
            return quiet and motion.thrust < low
        if not motion.height_known:  # PX4 sees no vertical motion, nor that there is none
            return False
        # level and descending, it is held up by less than its weight until the ground does it
        return quiet and motion.force > _HELD
