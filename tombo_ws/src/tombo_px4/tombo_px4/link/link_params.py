"""Parameters of a MAVLink link, and what the bridge sends over it by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tombo_dynamics.errors import unknown_name
from tombo_dynamics.params import param

ODOMETRY, VISION, MOCAP = "odometry", "vision", "mocap"
MOCAP_MESSAGES = {
    ODOMETRY: "ODOMETRY, estimator type VISION",
    VISION: "VISION_POSITION_ESTIMATE",
    MOCAP: "ATT_POS_MOCAP, which EKF2 does not fuse",
}
"""What carries the poses to PX4 -> which message that is."""
ONBOARD, GROUND_STATION = "onboard", "gcs"
HEARTBEATS = {
    ONBOARD: "MAV_TYPE_ONBOARD_CONTROLLER: PX4's words come as events",
    GROUND_STATION: "MAV_TYPE_GCS: PX4's texts come too, but PX4 takes the bridge for its ground "
    "station (NAV_DLL_ACT)",
}
"""What the bridge says it is."""


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
    heartbeat_type: str = plain(
        ONBOARD, "what the bridge says it is: onboard, or gcs for PX4's texts (NAV_DLL_ACT)"
    )
    key_file: str = plain("", "file with the signing key, 32 bytes; empty: nothing is signed")
    allow_remote: bool = plain(False, "true: speak to other machines than this one")

    def check(self) -> None:
        """Refuse an unknown type of heartbeat.

        Raises:
            InputError: names the parameter and what is accepted.
        """
        if self.heartbeat_type not in HEARTBEATS:
            raise unknown_name("value of link.heartbeat_type", self.heartbeat_type, HEARTBEATS)
