"""The reaction as a node, in line between mission and controller: one set point in, one out."""

from __future__ import annotations

from typing import Any

from tombo_bag.markers import GREEN, RED, point_marker
from tombo_bag.topics import MARKERS, REACTION_STATUS
from tombo_collision.reaction_core import ReactionCore
from tombo_ros.core_node import CoreNode, main_of
from tombo_ros.pacing import COLLISION


class ReactionNode(CoreNode):
    """Hosts the reaction, and shows x_c and x_r of each collision."""

    def __init__(self) -> None:
        """Advertise what is drawn."""
        super().__init__(ReactionCore, priority=COLLISION)
        self._markers = self.advertise(MARKERS)
        self._collisions = 0

    def on_published(self, topic: str, message: Any) -> None:
        """Show the points of a new decision."""
        if topic != REACTION_STATUS.name or message.collisions == self._collisions:
            return
        self._collisions = message.collisions
        if message.collisions:
            for name, place, colour in (("x_c", message.x_c, RED), ("x_r", message.x_r, GREEN)):
                self._markers.publish(point_marker(message.stamp_ns, name, place, colour))


main = main_of(ReactionNode)

if __name__ == "__main__":
    main()
