"""Recover in the propeller's own time: at once to x_r, the controller knowing the folded rotor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tombo_collision.decision import Decision, Estimate, Guided, length
from tombo_collision.reactions import Reaction
from tombo_collision.reactions.bounce import bounce_direction
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import param
from tombo_dynamics.rotation import yaw_of


@dataclass(frozen=True)
class Reflex(Reaction):
    """Known by the IMU, off the surface, with the controller's gains of the recovery.

    The controller knows of a strike within milliseconds, and shares thrust and torques by what
    each rotor can give while one is folded. The set point is x_r = x_c + d_r n_r at once; n_r is
    the direction of the push, or, where only the motion capture has seen the collision, against
    the flight. Yaw follows the vehicle until it turns no more.
    """

    name: ClassVar[str] = "reflex"
    needs: ClassVar[tuple[str, ...]] = ("mocap", "imu")
    recovers: ClassVar[bool] = True

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "as bounce")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
    push_share: float = param(
        1.0,
        "1",
        (0.0, 1.0),
        "share of the push's direction in n_r, the rest is against the flight",
        "the push points off the surface: the neighbour's disc leaves it too",
    )
    timeout: float = param(
        4.0,
        "s",
        (0.5, 60.0),
        "after this time the mission holds x_r with the cascade's gains",
        "three times the recovery",
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return x_r = x_c + d_r n_r."""
        n_r = off_surface(event, self.push_share)
        x_r = event.contact_position + self.distance * n_r
        x_r[2] = max(x_r[2], self.height_min)
        yaw = yaw_of(estimate.attitude)
        return Guided(event.contact_position, n_r, x_r, self.timeout, yaw)


def off_surface(event: CollisionEvent, push_share: float = 1.0) -> Array:
    """Return n_r (3): along the push, in part or whole; against the flight where none is known."""
    against = bounce_direction(event.flight_direction)
    mixed = (1.0 - push_share) * against + push_share * event.push
    size = length(mixed)
    return mixed / size if size > 0.1 else against
