"""Recover in the propeller's own time: at once to x_r, the controller knowing the folded rotor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tombo_collision.reactions import OffSurface


@dataclass(frozen=True)
class Reflex(OffSurface):
    """Known by the IMU, off the surface, with the controller's gains of the recovery.

    The controller knows of a strike within milliseconds, and shares thrust and torques by what
    each rotor can give while one is folded. The set point is x_r = x_c + d_r n_r at once; n_r is
    the direction of the push, or, where only the motion capture has seen the collision, against
    the flight. Yaw follows the vehicle until it turns no more.
    """

    name: ClassVar[str] = "reflex"
    recovers: ClassVar[bool] = True
