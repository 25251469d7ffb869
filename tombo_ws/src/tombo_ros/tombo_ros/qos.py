"""Quality of service of a topic: as an rclpy profile, and in lockstep."""

from __future__ import annotations

from dataclasses import replace

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tombo_bag.qos import Qos
from tombo_bag.topics import CLOCK, DIAGNOSTICS, MARKERS, TF, TopicSpec

LOCKSTEP = Qos(depth=2000, durability="transient_local")
"""Of all topics in lockstep: reliable, and a late subscriber gets the earlier messages, too."""
UNCOUNTED = (DIAGNOSTICS.name, MARKERS.name, TF.name, CLOCK.name)
"""Topics outside of the lockstep: no core takes them."""


def profile(qos: Qos, depth: int | None = None) -> QoSProfile:
    """Return the profile; `depth` in place of the topic's own for who may not lose a message."""
    return QoSProfile(
        depth=qos.depth if depth is None else depth,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )


def lockstep_spec(spec: TopicSpec) -> TopicSpec:
    """Return a topic as it is in lockstep."""
    return spec if spec.name in UNCOUNTED else replace(spec, qos=LOCKSTEP)
