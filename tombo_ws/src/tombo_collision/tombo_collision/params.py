"""Parameters of collision detection and reaction."""

from __future__ import annotations

from dataclasses import dataclass, field

from tombo_dynamics.errors import unknown_name
from tombo_dynamics.params import param

TRIGGERS = ("region", "innovation", "both", "none")


@dataclass(frozen=True)
class DetectorParams:
    """Collision detector on the mocap pose.

    Raises:
        InputError: the trigger's name is unknown.
    """

    trigger: str = field(
        default="innovation",
        metadata={"doc": "region: the known obstacle; innovation: an unknown one; both; none"},
    )
    region_x: float = param(1.7, "m", (-1e3, 1e3), "known x_c, map x", "paper: 1.7 m ahead")
    region_y: float = param(0.0, "m", (-1e3, 1e3), "known x_c, map y", "paper")
    region_z: float = param(2.0, "m", (-1e3, 1e3), "known x_c, map z", "paper: 2 m high")
    region_radius: float = param(
        0.18,
        "m",
        (0.01, 5.0),
        "distance from x_c across the flight direction",
        "the authors' flight script",
    )
    region_depth: float = param(
        0.12,
        "m",
        (0.005, 5.0),
        "distance from x_c along the flight direction",
        "the authors' flight script (0.124 for the rigid propeller)",
    )
    threshold: float = param(
        60.0,
        "1",
        (1.0, 1e4),
        "normalised innovation squared (six degrees of freedom) that fires",
        "latency against false alarms, docs/collision.md",
    )
    position_noise: float = param(
        0.001,
        "m",
        (1e-5, 0.1),
        "standard deviation of mocap position, each axis",
        "paper: 1.2 mm accuracy, plus pose jitter",
    )
    rate_noise: float = param(
        0.12,
        "rad/s",
        (1e-4, 5.0),
        "standard deviation of a rate from two mocap attitudes 33 ms apart or more; in inverse "
        "proportion to the time between closer ones",
        "0.002 rad twice, over a thirtieth of a second, plus margin",
    )
    acceleration_xy: float = param(
        1.2,
        "m/s^2",
        (0.01, 50.0),
        "acceleration that attitude does not explain, horizontal",
        "drag, gusts and thrust changes in a tilt",
    )
    acceleration_z: float = param(
        4.0,
        "m/s^2",
        (0.01, 50.0),
        "acceleration that attitude does not explain, vertical",
        "thrust changes in steps of height",
    )
    tilt_acceleration: float = param(
        25.0,
        "rad/s^2",
        (0.1, 500.0),
        "angular acceleration of roll and pitch in normal flight",
        "attitude steps of the cascade",
    )
    yaw_acceleration: float = param(
        4.0,
        "rad/s^2",
        (0.1, 500.0),
        "angular acceleration of yaw in normal flight",
        "yaw has a tenth of roll's authority",
    )
    arm_height: float = param(
        0.8,
        "m",
        (0.0, 100.0),
        "height above the first pose from which the detector watches",
        "keeps take-off and landing out",
    )
    floor_height: float = param(
        0.0,
        "m",
        (-1e3, 1e3),
        "height of the floor in map; a first pose more than arm_height above it is one in flight, "
        "and the detector watches at once",
        "the mocap's floor is its zero",
    )
    gap_max: float = param(
        0.25, "s", (0.05, 5.0), "gap in mocap after which the filter starts again", "eight samples"
    )
    holdoff: float = param(
        2.5,
        "s",
        (0.1, 60.0),
        "no second event before this time after one",
        "the paper's unstable phase of 1.5 s, plus the return to level flight",
    )
    jump_distance: float = param(
        0.05,
        "m",
        (1e-3, 10.0),
        "a pose further than this, plus what jump_speed allows, from the constant-velocity "
        "prediction has jumped: markers were mixed up",
        "twenty times the scatter of a prediction from noisy poses",
    )
    jump_speed: float = param(
        3.0,
        "m/s",
        (0.1, 100.0),
        "change of velocity that a strike can make, above taking away the speed there was",
        "the largest surprise in 100 simulated strikes at 0.7 m/s is a sixth of the limit",
    )
    jump_angle: float = param(
        0.5,
        "rad",
        (0.01, 6.4),
        "an attitude turned by more than this, plus what jump_rate allows, has jumped",
        "at 30 Hz 1.2 rad in all: a quarter turn, as from markers in a square, is a jump",
    )
    jump_rate: float = param(
        20.0,
        "rad/s",
        (0.1, 1000.0),
        "rate of turn that a strike can make",
        "simulated strikes and crashes: up to 18 rad/s",
    )

    def __post_init__(self) -> None:
        if self.trigger not in TRIGGERS:
            raise unknown_name("detector.trigger", self.trigger, TRIGGERS)


@dataclass(frozen=True)
class ReactionLimits:
    """How long the reaction goes on without an input."""

    pose_timeout: float = param(
        0.25,
        "s",
        (0.05, 5.0),
        "age of the motion capture's pose or of the estimate after which the vehicle flies blind",
        "as control.blind_timeout",
    )
    detector_timeout: float = param(
        0.5,
        "s",
        (0.05, 10.0),
        "silence of the detector, while poses come, after which the vehicle holds where it is",
        "15 poses at 30 Hz; 0.35 m of approach",
    )
    mission_timeout: float = param(
        0.3,
        "s",
        (0.04, 10.0),
        "silence of the mission after which the vehicle holds where it is",
        "15 set points",
    )
    hold_time: float = param(
        20.0,
        "s",
        (0.0, 600.0),
        "after holding for so long it falls silent: the controller holds, and lands",
        "a node is restarted in 5 s; with the controller's own 10 s half a minute",
    )
    event_age: float = param(
        1.0,
        "s",
        (0.05, 10.0),
        "an older collision is none to react to",
        "a detector answers within 0.12 s; a latched event of minutes ago is history",
    )
