"""Parameters of the contact trigger and of the loops that fly while a rotor is folded."""

from __future__ import annotations

from dataclasses import dataclass

from tombo_control.params import ControlParams
from tombo_dynamics.params import param


@dataclass(frozen=True)
class ContactParams:
    """When a reading of the accelerometer is a contact."""

    threshold: float = param(
        30.0,
        "m/s^2",
        (1.0, 1000.0),
        "horizontal specific force above which a sample may be of a contact",
        "30 flights: a strike shows 97 or more, `aggressive` 7.5, with disturbances 13",
    )
    noise_factor: float = param(
        5.0,
        "1",
        (0.0, 100.0),
        "it must also be so many times its own root mean square of the last 0.5 s",
        "vibration of four rotors has peaks of 2.8 times its own",
    )
    samples: float = param(
        2.0, "1", (1.0, 20.0), "so many samples on end", "one alone may be a fault of the sensor"
    )
    window: float = param(
        0.005,
        "s",
        (0.002, 0.02),
        "from the first of them to the decision which rotor was struck",
        "push and yaw rate are then ten times their noise",
    )
    holdoff: float = param(
        0.06,
        "s",
        (0.02, 5.0),
        "no second contact before this time after one",
        "a strike pushes for 14 ms; the neighbour's disc follows after 150 ms",
    )
    arm_height: float = param(
        0.8,
        "m",
        (0.0, 100.0),
        "height in map above which the trigger acts",
        "30 landings with disturbances show up to 20 m/s^2, take-offs 17; a hard one more",
    )


@dataclass(frozen=True)
class RecoveryParams(ControlParams):
    """The cascade's gains while it recovers; margins in docs/reactions.md.

    The integrals stay as they are: their values belong to straight blades.
    """

    position_p: float = param(
        2.5,
        "1/s",
        (0.05, 5.0),
        "velocity asked for per position error, within 0.16 m; `brake` decides further away",
        "below the velocity loop's 4 rad/s; a slower one takes the last decimetre in 0.7 s more",
    )
    brake: float = param(
        1.0,
        "m/s^2",
        (0.2, 100.0),
        "the velocity asked for can be stopped with this deceleration before the set point",
        "a tilt of 0.1 rad: calm by the paper's measure, 0.17 rad; with 1.5 it is not",
    )
    velocity_p: float = param(
        4.0,
        "1/s",
        (0.1, 15.0),
        "acceleration asked for per velocity error",
        "crossover 4 rad/s, two fifths of the attitude loop's",
    )
    velocity_i: float = param(
        0.0, "1/s^2", (0.0, 5.0), "acceleration per integrated velocity error", "held as it is"
    )
    velocity_d: float = param(
        0.0, "1", (0.0, 1.0), "acceleration taken back per measured acceleration", "not needed"
    )
    velocity_max_xy: float = param(
        1.05,
        "m/s",
        (0.1, 15.0),
        "horizontal velocity limit",
        "the fastest that `brake` can stop within 0.6 m; a higher one is tilt for nothing",
    )
    tilt_max: float = param(
        0.7,
        "rad",
        (0.05, 1.4),
        "limit of commanded tilt; the thrust that is left limits it as well",
        "after a fast strike the vehicle still flies ahead",
    )
    attitude_p: float = param(
        8.0,
        "1/s",
        (0.5, 20.0),
        "body rate asked for per attitude error, roll and pitch",
        "a third of the rate loop's; with 10 motors of 49 ms swing",
    )
    rate_p: float = param(
        30.0,
        "1/s",
        (1.0, 80.0),
        "angular acceleration per rate error, roll and pitch",
        "crossover 23 rad/s, at which the motor's 35 ms cost 39 deg: no lead is needed",
    )
    rate_i: float = param(
        0.0,
        "1/s^2",
        (0.0, 400.0),
        "angular acceleration per integrated rate error",
        "held as it is",
    )
    rate_d: float = param(
        0.0, "1", (0.0, 2.0), "angular acceleration taken back per measured one", "see rate_p"
    )
    yaw_rate_p: float = param(
        12.0,
        "1/s",
        (0.5, 40.0),
        "angular acceleration per yaw rate error",
        "the strike's 7 rad/s ask for all the torque there is until 2 rad/s are left",
    )
    rate_max: float = param(
        6.0, "rad/s", (0.5, 20.0), "roll and pitch rate limit", "0.6 rad of attitude error"
    )
    yaw_rate_i: float = param(
        0.0,
        "1/s^2",
        (0.0, 100.0),
        "angular acceleration per integrated yaw rate error",
        "held as it is",
    )
