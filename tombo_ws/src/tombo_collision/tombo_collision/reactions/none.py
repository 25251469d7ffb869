"""No reaction: collisions are seen, and nothing is done about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tombo_collision.reactions import Decision, Reaction
from tombo_dynamics.messages import CollisionEvent


@dataclass(frozen=True)
class NoReaction(Reaction):
    """The mission goes on as if nothing had happened."""

    name: ClassVar[str] = "none"
    needs: ClassVar[tuple[str, ...]] = ()

    def decide(self, event: CollisionEvent, last: Decision | None) -> Decision | None:
        """Decide nothing."""
        return None
