"""Quality of service of a recorded topic, in the words rosbag2 writes into a bag."""

from __future__ import annotations

from dataclasses import dataclass

_INFINITE = "    sec: 9223372036\n    nsec: 854775807"


@dataclass(frozen=True)
class Qos:
    """The offer of a publisher; `ros2 bag play` repeats it.

    Attributes:
        depth: messages kept for late subscribers and retries.
        reliability: `reliable` or `best_effort`.
        durability: `volatile` or `transient_local`.
    """

    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"

    def as_yaml(self) -> str:
        """Return the `offered_qos_profiles` text of rosbag2's metadata version 9 (Jazzy)."""
        return (
            "- history: keep_last\n"
            f"  depth: {self.depth}\n"
            f"  reliability: {self.reliability}\n"
            f"  durability: {self.durability}\n"
            f"  deadline:\n{_INFINITE}\n"
            f"  lifespan:\n{_INFINITE}\n"
            "  liveliness: automatic\n"
            f"  liveliness_lease_duration:\n{_INFINITE}\n"
            "  avoid_ros_namespace_conventions: false"
        )


STATE = Qos()
"""Streams whose next message replaces the last: setpoints, odometry, status."""

SENSOR = Qos(depth=5, reliability="best_effort")
"""Sensor data: the newest sample counts."""

STATUS = Qos(depth=1, durability="transient_local")
"""A state, at each change; a late subscriber gets the last one alone."""

EVENT = Qos(depth=10, durability="transient_local")
"""Events that a late subscriber must still get."""
