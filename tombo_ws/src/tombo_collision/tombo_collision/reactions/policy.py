"""A trained policy: a small network of a file says at 50 Hz where to go."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tombo_collision.decision import Decision, Estimate, Guided, Reference
from tombo_collision.network import Network, Row, answer, read_network
from tombo_collision.reactions import OffSurface
from tombo_collision.steering import HIGH, Steering, observe, steer
from tombo_dynamics.message_records import PositionSetpointRecord
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import structure


@dataclass(frozen=True)
class Policy(OffSurface):
    """A network moves the set point about x_r, and feeds acceleration forward.

    Known by the IMU, off the surface, flown with the controller's gains of the recovery; without
    a network it rests at x_r, as reflex.
    """

    name: ClassVar[str] = "policy"
    recovers: ClassVar[bool] = True

    network: tuple[tuple[Row, ...], ...] | None = structure(
        read_network, "the policy: a file's path, or the layers that stood in it", "docs/gym.md"
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return the way to x_r that the policy steers."""
        decision = super().begin(event, estimate, last)
        if isinstance(decision, Steered):
            decision.steering.rotor = event.rotor
        return decision

    def way(self, decision: Guided, estimate: Estimate) -> Guided:
        """Return the steered way."""
        return Steered(**vars(decision), network=self.network)


@dataclass
class Steered(Guided):
    """A decision whose reference is a policy's."""

    network: Network | None

    def __post_init__(self) -> None:
        """Put down what compiled code needs of it."""
        across = math.hypot(float(self.n_r[0]), float(self.n_r[1]))
        along = self.n_r[:2] / across if across > 1e-6 else np.array([1.0, 0.0])
        self.steering = steering = Steering.new()
        steering.x_c, steering.x_r, steering.along = self.x_c, self.x_r, along
        steering.timeout, steering.yaw, steering.rotor = self.timeout, self.yaw, -1

    def observation(self, time_s: float, estimate: Estimate) -> Any:
        """Return the observation of the policy (23), float32."""
        observation = np.empty(HIGH.size, np.float32)
        e = estimate
        observe(self.steering, time_s, e.position, e.velocity, e.attitude, e.rates, observation)
        return observation

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Return the set point that the policy asks for."""
        action = answer(self.network, self.observation(time_s, estimate))
        out: Any = PositionSetpointRecord.new()
        steer(self.steering, action, estimate.attitude, estimate.rates, out)
        return Reference(out.position, out.velocity, out.acceleration, float(out.yaw))
