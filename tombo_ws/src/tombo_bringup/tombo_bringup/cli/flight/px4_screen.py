"""Output of `tombo px4`: where to connect, texts of the vehicle, and a live line of the state."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tombo_bringup.cli.errors import printable
from tombo_px4.bridge.modes import mode_name

if TYPE_CHECKING:
    from rich.live import Live

    from tombo_px4.protocol.endpoint import Endpoint

_LIVE_NS = 250_000_000
_RECENTLY_HEARD_US = 3_000_000
_SEVERITY_COLOURED = 4
"""MAV_SEVERITY_WARNING: this and graver is coloured."""


@contextmanager
def new_screen() -> Iterator[LineScreen]:
    """Make the screen that fits where standard output leads to."""
    if not sys.stdout.isatty():
        yield LineScreen()
        return
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(), auto_refresh=False, redirect_stderr=False) as live:
        yield LiveScreen(live)


def where_to_connect(host: str, port: int, ground_port: int) -> list[str]:
    """Return the lines that say how a client reaches the vehicle."""
    return [
        "A simulated PX4 1.17 quadrotor. It exchanges messages with a client that listens at",
        f"  MAVSDK          udpin://{host}:{port}",
        f"  MAVProxy        mavproxy.py --master=udpin:{host}:{ground_port}",
        f"  QGroundControl  a UDP link that listens on port {ground_port} (14550: by itself)",
        "Ctrl-C stops it.",
    ]


def state_line(endpoint: Endpoint, boot_ns: int, slipped_ns: int) -> str:
    """Return the vehicle's state in one line."""
    v = endpoint.vehicle
    x, y, z = (float(p) for p in v.estimate.position)
    heard = [
        f"{system}/{component}"
        for (system, component), when in sorted(endpoint.message_router.heard_systems.items())
        if v.boot_us - when < _RECENTLY_HEARD_US
    ]
    words = [
        f"{boot_ns * 1e-9:7.1f} s",
        f"{'armed' if v.armed else 'disarmed'}, {mode_name(v.mode)}, "
        f"{v.landed.name.lower().replace('_', ' ')}",
        f"x {x:.2f} y {y:.2f} z {z:.2f} m" if v.health.local_position else "no position",
        f"{v.battery.voltage:.1f} V {100.0 * v.battery.remaining:.0f} %",
        f"load {100.0 * endpoint.telemetry.load:.0f} %",
        f"heard {', '.join(heard)}" if heard else "nobody heard",
    ]
    if slipped_ns:
        words.append(f"{slipped_ns * 1e-9:.1f} s behind")
    return " · ".join(words)


class LineScreen:
    """Lines of text: the texts of the vehicle."""

    def begin(self, lines: Sequence[str]) -> None:
        """Say where it can be reached."""
        for line in lines:
            self._put(line)

    def redraw(self, endpoint: Endpoint, boot_ns: int, slipped_ns: int) -> None:
        """Print the new texts; called hundreds of times a second."""
        for severity, text in endpoint.statustext.said:
            self._put(
                f"{boot_ns * 1e-9:8.2f} s  {text}",
                "yellow" if severity <= _SEVERITY_COLOURED else "",
            )
        endpoint.statustext.said.clear()

    def end(self, endpoint: Endpoint, slipped_ns: int) -> None:
        """Say how long it ran, and what was refused."""
        for reason, count in sorted(endpoint.statustext.counts.items()):
            self._put(f"  {count} x {reason}")
        late = f", {slipped_ns * 1e-9:.1f} s behind real time" if slipped_ns else ""
        self._put(f"stopped after {endpoint.vehicle.boot_us * 1e-6:.1f} s{late}")

    def _put(self, text: str, style: str = "") -> None:
        print(printable(text), flush=True)


class LiveScreen(LineScreen):
    """The state at the bottom of the terminal; texts scroll above it."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self._next_ns = 0

    def redraw(self, endpoint: Endpoint, boot_ns: int, slipped_ns: int) -> None:
        """Print the new texts; draw the state a few times a second."""
        super().redraw(endpoint, boot_ns, slipped_ns)
        if boot_ns < self._next_ns:
            return
        self._next_ns = boot_ns + _LIVE_NS
        from rich.text import Text

        text = Text(state_line(endpoint, boot_ns, slipped_ns), no_wrap=True, overflow="ellipsis")
        self._live.update(text, refresh=True)

    def _put(self, text: str, style: str = "") -> None:
        from rich.text import Text

        self._live.console.print(Text(text, style))
