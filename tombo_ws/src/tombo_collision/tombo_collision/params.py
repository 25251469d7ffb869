"""Parameters of collision detection and reaction."""

from __future__ import annotations

from dataclasses import dataclass, field

from tombo_dynamics.params import param

TRIGGERS = ("region", "innovation", "both", "none")


@dataclass(frozen=True)
class DetectorParams:
    """Collision detector on the mocap pose."""

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
    gap_max: float = param(
        0.25, "s", (0.05, 5.0), "gap in mocap after which the filter starts anew", "eight samples"
    )
    holdoff: float = param(
        2.5,
        "s",
        (0.1, 60.0),
        "no second event before this time after one",
        "the paper's unstable phase of 1.5 s, plus the return to level flight",
    )


@dataclass(frozen=True)
class ReactionParams:
    """Reaction to a collision: x_r = x_c + d_r n_r."""

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "paper")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
    timeout: float = param(
        12.0,
        "s",
        (1.0, 600.0),
        "the reaction is called off as not settled after this time",
        "more than twice the paper's recovery time",
    )
