"""Parameters of the PX4 bridge: its link, its messages, and conditions for arming."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.params import param, plain

SIMULATED = "simulated"
"""The poses are those of a simulated vehicle that the same command has started."""


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


@dataclass(frozen=True)
class BridgeParams:
    """Messages of the bridge, its time-outs, and conditions of a pose before it arms."""

    axes_evidence: str = plain(
        "",
        "file with the proofs of the mocap body's axes, by hand; empty: "
        "~/.config/tombo/px4_axes.yaml; simulated: none is needed, the poses are of a model",
    )
    tracked_body: str = plain(
        "", "name of the rigid body in the motion capture; a new name asks for a new proof"
    )
    stream_rate: float = param(
        20.0,
        "Hz",
        (3.0, 100.0),
        "set points are sent at least so often; a new one leaves at once",
        "PX4 drops OFFBOARD after COM_OF_LOSS_T = 1 s; usual are 20 Hz",
    )
    odometry_rate: float = param(
        100.0, "Hz", (10.0, 250.0), "asked of PX4: ODOMETRY", "five times the position loop"
    )
    imu_rate: float = param(
        100.0, "Hz", (10.0, 250.0), "asked of PX4: HIGHRES_IMU", "PX4 sends 50 Hz unasked"
    )
    pose_loss_time: float = param(
        1.0,
        "s",
        (0.2, 4.0),
        "in flight no pose that can be used for so long: PX4 lands",
        "PX4 coasts for 5 s (EKF2_NOAID_TOUT), which a landing from 2 m takes",
    )
    pose_age_max: float = param(
        0.2,
        "s",
        (0.01, 1.0),
        "a pose older than this when it arrives is too late for EKF2",
        "PX4: EKF2_DELAY_MAX",
    )
