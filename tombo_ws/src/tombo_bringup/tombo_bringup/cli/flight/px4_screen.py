"""Output of `tombo px4`: where to connect, and the texts of the vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tombo_bringup.cli.tables import Scroll

if TYPE_CHECKING:
    from tombo_px4.protocol.endpoint import Endpoint

_SEVERITY_COLOURED = 4
"""MAV_SEVERITY_WARNING: this and graver is coloured."""


def where_to_connect(host: str, port: int, ground_port: int) -> list[str]:
    """Return the lines that say how a client reaches the vehicle."""
    return [
        "A simulated PX4 1.17 quadrotor. It exchanges messages with a client that listens at",
        f"  MAVSDK          udpin://{host}:{port}",
        f"  MAVProxy        mavproxy.py --master=udpin:{host}:{ground_port}",
        f"  QGroundControl  a UDP link that listens on port {ground_port} (14550: by itself)",
        "Ctrl-C stops it.",
    ]


class Screen:
    """The texts of the vehicle, as lines."""

    def __init__(self, scroll: Scroll) -> None:
        self._scroll = scroll

    def begin(self, lines: Sequence[str]) -> None:
        """Say where it can be reached."""
        for line in lines:
            self._scroll.put(line)

    def print_texts(self, endpoint: Endpoint, boot_ns: int) -> None:
        """Print new texts; called hundreds of times a second."""
        for severity, text in endpoint.announcer.sent_texts:
            style = "yellow" if severity <= _SEVERITY_COLOURED else ""
            self._scroll.put(f"{boot_ns * 1e-9:8.2f} s  {text}", style)
        endpoint.announcer.sent_texts.clear()

    def end(self, endpoint: Endpoint, slipped_ns: int) -> None:
        """Say how long it ran, and what was refused."""
        for reason, count in sorted(endpoint.announcer.refused.items()):
            self._scroll.put(f"  {count} x {reason}")
        late = f", {slipped_ns * 1e-9:.1f} s behind real time" if slipped_ns else ""
        self._scroll.put(f"stopped after {endpoint.vehicle.boot_us * 1e-6:.1f} s{late}")
