"""Output of `tombo px4`: where to connect, texts of the vehicle, and a live line of the state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from tombo_bringup.cli.tables import Scroll
from tombo_px4.modes import mode_name

if TYPE_CHECKING:
    from tombo_px4.protocol.endpoint import Endpoint

_RECENTLY_HEARD_US = 3_000_000
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


def state_line(endpoint: Endpoint, boot_ns: int, slipped_ns: int) -> str:
    """Return the vehicle's state in one line."""
    v = endpoint.vehicle
    x, y, z = (float(p) for p in v.estimate.position)
    clients = [
        f"{system}/{component}"
        for (system, component), when in sorted(endpoint.heard_systems.items())
        if v.boot_us - when < _RECENTLY_HEARD_US
    ]
    words = [
        f"{boot_ns * 1e-9:7.1f} s",
        f"{'armed' if v.armed else 'disarmed'}, {mode_name(v.mode)}, "
        f"{v.landed.name.lower().replace('_', ' ')}",
        f"x {x:.2f} y {y:.2f} z {z:.2f} m" if v.health.local_position else "no position",
        f"{v.battery.voltage:.1f} V {100.0 * v.battery.remaining:.0f} %",
        f"heard {', '.join(clients)}" if clients else "no client connected",
    ]
    if slipped_ns:
        words.append(f"{slipped_ns * 1e-9:.1f} s behind")
    return " · ".join(words)


def redraw(scroll: Scroll, endpoint: Endpoint, boot_ns: int, slipped_ns: int) -> None:
    """Print new texts, draw the state now and then; called hundreds of times a second."""
    for severity, text in endpoint.announcer.sent_texts:
        style = "yellow" if severity <= _SEVERITY_COLOURED else ""
        scroll.put(f"{boot_ns * 1e-9:8.2f} s  {text}", style)
    endpoint.announcer.sent_texts.clear()
    if scroll.live is not None and scroll.due():
        scroll.show(state_line(endpoint, boot_ns, slipped_ns))


def end_lines(endpoint: Endpoint, slipped_ns: int) -> Iterator[str]:
    """Yield how long it ran, and what was refused."""
    for reason, count in sorted(endpoint.announcer.refused.items()):
        yield f"  {count} x {reason}"
    late = f", {slipped_ns * 1e-9:.1f} s behind real time" if slipped_ns else ""
    yield f"stopped after {endpoint.vehicle.boot_us * 1e-6:.1f} s{late}"
