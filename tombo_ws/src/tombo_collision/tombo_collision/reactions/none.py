"""No reaction: collisions are seen, and nothing is done about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tombo_collision.decision import Decision, Estimate
from tombo_collision.reactions import Reaction
from tombo_dynamics.messages import CollisionEvent


@dataclass(frozen=True)
class NoReaction(Reaction):
    """The mission goes on as if nothing had happened."""

    name: ClassVar[str] = "none"
    needs: ClassVar[tuple[str, ...]] = ()

    def begin(
        self, event: CollisionEvent, estimate: Estimate, last: Decision | None
    ) -> Decision | None:
        """Decide nothing."""
        return None
