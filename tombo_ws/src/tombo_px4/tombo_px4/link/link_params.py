"""Parameters of a MAVLink link."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tombo_dynamics.params import param


def plain(default: str | bool, doc: str) -> Any:
    """Declare a field of a parameter record that is no number."""
    return field(default=default, metadata={"doc": doc})


@dataclass(frozen=True)
class LinkParams:
    """URL of the link, system and component ids."""

    url: str = plain(
        "udpin://127.0.0.1:14540",
        "udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial:///dev/tty…:BAUD",
    )
    system: int = param(1, "1", (1, 255), "MAVLink system of the vehicle", "PX4: MAV_SYS_ID")
    component: int = param(1, "1", (1, 255), "MAVLink component of its autopilot", "PX4: 1")
    own_system: int = param(
        245, "1", (1, 255), "MAVLink system of this bridge", "free; 255 is a ground station's"
    )
    own_component: int = param(
        191, "1", (1, 255), "MAVLink component of this bridge", "on-board computer"
    )
    key_file: str = plain("", "file with the signing key, 32 bytes; empty: nothing is signed")
    allow_remote: bool = plain(False, "true: speak to other machines than this one")
