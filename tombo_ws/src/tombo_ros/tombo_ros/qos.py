"""Quality of service of a topic as an rclpy profile."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tombo_bag.qos import Qos


def profile(qos: Qos, depth: int | None = None) -> QoSProfile:
    """Return the profile; `depth` in place of the topic's own for who may not lose a message."""
    return QoSProfile(
        depth=qos.depth if depth is None else depth,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )
