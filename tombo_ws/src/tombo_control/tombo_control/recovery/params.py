"""Parameters of the contact trigger and of the loops that fly while a rotor is folded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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


def _other(name: str, default: float, source: str, doc: str = "") -> Any:
    """Declare a gain of `ControlParams` with another default: unit and bounds are the same."""
    meta = ControlParams.__dataclass_fields__[name].metadata
    return param(default, meta["unit"], meta["bounds"], doc or meta["doc"], source)


@dataclass(frozen=True)
class RecoveryParams(ControlParams):
    """The cascade's gains while it recovers; margins in docs/reactions.md.

    The integrals stay as they are: their values belong to straight blades.
    """

    position_p: float = _other(
        "position_p",
        2.5,
        "below the velocity loop's 4 rad/s; a slower one takes the last decimetre in 0.7 s more",
        "velocity asked for per position error, within 0.16 m; `brake` decides further away",
    )
    brake: float = _other(
        "brake",
        1.0,
        "a tilt of 0.1 rad: calm by the paper's measure, 0.17 rad; with 1.5 it is not",
    )
    velocity_p: float = _other(
        "velocity_p", 4.0, "crossover 4 rad/s, two fifths of the attitude loop's"
    )
    velocity_i: float = _other("velocity_i", 0.0, "held as it is")
    velocity_d: float = _other("velocity_d", 0.0, "not needed")
    velocity_max_xy: float = _other(
        "velocity_max_xy",
        1.05,
        "the fastest that `brake` can stop within 0.6 m; a higher one is tilt for nothing",
    )
    tilt_max: float = _other(
        "tilt_max",
        0.7,
        "after a fast strike the vehicle still flies ahead",
        "limit of commanded tilt; the thrust that is left limits it as well",
    )
    attitude_p: float = _other(
        "attitude_p", 8.0, "a third of the rate loop's; with 10 motors of 49 ms swing"
    )
    rate_p: float = _other(
        "rate_p",
        30.0,
        "crossover 23 rad/s, at which the motor's 35 ms cost 39 deg: no lead is needed",
    )
    rate_i: float = _other("rate_i", 0.0, "held as it is")
    rate_d: float = _other("rate_d", 0.0, "see rate_p")
    yaw_rate_p: float = _other(
        "yaw_rate_p",
        12.0,
        "the strike's 7 rad/s ask for all the torque there is until 2 rad/s are left",
    )
    rate_max: float = _other("rate_max", 6.0, "0.6 rad of attitude error")
    yaw_rate_i: float = _other("yaw_rate_i", 0.0, "held as it is")
