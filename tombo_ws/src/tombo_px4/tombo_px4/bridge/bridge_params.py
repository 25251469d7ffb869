"""Parameters of the PX4 bridge: what it sends, and conditions for arming."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_dynamics.errors import unknown_name
from tombo_dynamics.params import param
from tombo_px4.link.link_params import plain

POSITION, ATTITUDE, RATES = "position", "attitude", "rates"
SETPOINT_KINDS = {
    POSITION: "/setpoint as SET_POSITION_TARGET_LOCAL_NED: PX4's own cascade flies it",
    ATTITUDE: "/attitude_setpoint as SET_ATTITUDE_TARGET",
    RATES: "/rates_setpoint as SET_ATTITUDE_TARGET",
}
"""What PX4 is told to follow in OFFBOARD."""

SIMULATED = "simulated"
"""The poses are those of a simulated vehicle that the same command has started."""


@dataclass(frozen=True)
class BridgeParams:
    """What the bridge sends, its time-outs, and what a pose must fulfil before it arms."""

    setpoint: str = plain(POSITION, "what PX4 follows: position, attitude or rates")
    axes_evidence: str = plain(
        "",
        "file with the proofs of the mocap body's axes, by hand; empty: "
        "~/.config/tombo/px4_axes.yaml; simulated: none is needed, the poses are of a model",
    )
    tracked_body: str = plain(
        "", "name of the rigid body in the motion capture; a new name asks for a new proof"
    )
    attitude_lag: float = param(
        0.2,
        "s",
        (0.0, 1.0),
        "PX4's attitude is so late: the velocity fed forward is ahead by this times acceleration",
        "1 / MC_PITCH_P = 0.15 s, rate loop and link 0.05 s; measured best from 0 to 0.3 s",
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
    link_timeout: float = param(
        2.5,
        "s",
        (0.5, 30.0),
        "no heartbeat for so long: the link is lost",
        "PX4 sends 1 Hz and lets nobody change it: one may miss",
    )
    pose_loss_time: float = param(
        1.0,
        "s",
        (0.2, 4.0),
        "in flight no pose that can be used for so long: PX4 lands",
        "PX4 coasts for 5 s (EKF2_NOAID_TOUT), which a landing from 2 m takes",
    )
    takeoff_drift_max: float = param(
        0.15,
        "m",
        (0.05, 2.0),
        "so far beside its set point in the take-off: lands without positions",
        "hover over a real PX4 in gusts: 0.06 m RMS, in the first seconds at most 0.1 m",
    )
    takeoff_check_height: float = param(
        0.6,
        "m",
        (0.2, 100.0),
        "height above the place of take-off that it does not leave before the axes have shown",
        "wrong axes then end below 1 m: brakes within 0.15 m from 0.6 m/s",
    )
    takeoff_check_time: float = param(
        8.0,
        "s",
        (0.0, 30.0),
        "after the lift-off a calm vehicle, whose axes have not shown, waits no longer for them",
        "over a real PX4 wrong axes show 2 to 7 s after the lift-off",
    )
    pose_jump_max: float = param(
        0.5,
        "m",
        (0.1, 5.0),
        "in flight a pose so far from PX4's own position is not sent",
        "PX4's gate (EKF2_EVP_GATE 5, EKF2_EVP_NOISE 0.1); a second later it would follow it",
    )
    pose_age_max: float = param(
        0.2,
        "s",
        (0.01, 1.0),
        "a pose older than this when it arrives is too late for EKF2",
        "PX4: EKF2_DELAY_MAX",
    )
    ready_time: float = param(
        3.0,
        "s",
        (0.0, 60.0),
        "the checks have passed for so long before /odometry, and with it the mission, begins",
        "PX4's estimator settles for some seconds after its first position",
    )
    position_error_max: float = param(
        0.2,
        "m",
        (0.01, 2.0),
        "PX4's position may be so far from the pose at rest",
        "two EKF2_EVP_NOISE; measured in flight: 0.07 to 0.13 m at 50 Hz",
    )
    yaw_error_max: float = param(
        0.1745, "rad", (0.01, 1.57), "PX4's yaw may be so far from the pose's", "10 deg"
    )
    tilt_error_max: float = param(
        0.1745, "rad", (0.01, 0.78), "the pose's up may be so far from gravity's", "10 deg"
    )

    def check(self) -> None:
        """Refuse an unknown kind of set point.

        Raises:
            InputError: names the parameter and what is accepted.
        """
        if self.setpoint not in SETPOINT_KINDS:
            raise unknown_name("value of px4.setpoint", self.setpoint, SETPOINT_KINDS)
