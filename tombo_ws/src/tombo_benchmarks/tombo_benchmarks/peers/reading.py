"""What one measurement gives."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reading:
    """Steps of vehicles, and the time that they took."""

    steps: int
    wall_s: float
    processor_s: float
    """Of all threads."""

    @property
    def per_processor_s(self) -> float:
        """Steps in a second of a processor core."""
        return self.steps / self.processor_s

    @property
    def per_wall_s(self) -> float:
        """Steps in a second of wall time."""
        return self.steps / self.wall_s
