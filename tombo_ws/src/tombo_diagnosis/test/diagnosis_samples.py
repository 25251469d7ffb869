"""Made-up diagnoses with the look of real ones, for the tests of report, files and command.

Circles at several speeds; the model lacks drag. The residual is the noise of an accelerometer
through the filter: correlated over a tenth of a second.
"""

import math

import numpy as np
from scipy.signal import butter, sosfiltfilt

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import (
    Cause,
    Dependence,
    Diagnosis,
    Experiment,
    FlightSummary,
    Leftover,
    LeftoverSamples,
    Residual,
    Score,
)
from tombo_flight.extended_model import FittedParameter, Gain

DRAG = 0.283
MASS = 1.2
CHANNELS = (
    ("specific_force_x", "m/s^2", 0.06),
    ("specific_force_y", "m/s^2", 0.06),
    ("specific_force_z", "m/s^2", 0.12),
    ("angular_acceleration_x", "rad/s^2", 0.9),
    ("angular_acceleration_y", "rad/s^2", 0.9),
    ("angular_acceleration_z", "rad/s^2", 0.35),
)
SPEEDS = (0.8, 1.4, 2.0, 2.6)


def residuals(flights: int, seconds: float, extended: bool) -> tuple[Residual, ...]:
    rng, rate = np.random.default_rng(5), 100.0
    low_pass = butter(2, 8.0, fs=rate, output="sos")
    t = np.arange(0.0, seconds, 1.0 / rate)
    result = []
    for i in range(flights):
        ease = np.clip(t / 4.0, 0.0, 1.0) * np.clip((t[-1] - t) / 3, 0, 1)
        speed = SPEEDS[i % len(SPEEDS)] * ease
        turn = np.cumsum(speed) / rate / 1.2
        wobble = 0.15 * sosfiltfilt(low_pass, rng.standard_normal((4, t.size)))
        velocity = np.stack((speed * np.cos(turn), speed * np.sin(turn), wobble[2])) + wobble[:3]
        drivers = {f"body_velocity_{a} [m/s]": v for a, v in zip("xyz", velocity, strict=True)}
        drivers["height [m]"] = 1.5 + 0.3 * np.sin(0.4 * t) + wobble[3]
        drivers["voltage [V]"] = 16.4 - 0.02 * t - 0.1 * speed
        for k, (channel, unit, sigma) in enumerate(CHANNELS):
            noise = sosfiltfilt(low_pass, rng.standard_normal(t.size))
            after = sigma * noise / noise.std()
            gap = -DRAG / MASS * velocity[k] if k < 2 else 0.02 * velocity[2] * (k == 2)
            before = after + gap
            left = after if extended else before
            result.append(
                Residual(f"circle_{i + 1}", channel, unit, t, before, left, sigma, drivers)
            )
    return tuple(result)


CAUSE = Cause(
    "linear_rotor_drag",
    (
        FittedParameter("d_xy", "N s/m", 0.0, DRAG, 0.2761, 0.2903),
        FittedParameter("d_z", "N s/m", 0.0, 0.041, -0.018, 0.1),
    ),
    0.987,
    "force against the velocity, in proportion to it",
    ((1.3e-5, 2.0e-7), (2.0e-7, 9.1e-4)),
)
MASS_ERROR = Cause(
    "mass_error",
    (FittedParameter("fraction", "1", 0.0, 0.062, 0.0561, 0.0679),),
    0.51,
    "specific force off by one factor on all axes, in hover and in turns alike",
    ((9e-6,),),
)
THRUST_ERROR = Cause(
    "thrust_coefficient_error",
    (FittedParameter("fraction", "1", 0.0, -0.058, -0.0637, -0.0523),),
    0.47,
    "specific force along body z off by a factor of thrust",
    ((8e-6,),),
)
GAIN = (
    Gain("specific_force_x", "m/s^2", "one step", 0.239, 0.061, 0.745, 0.71, 0.78, 6),
    Gain("specific_force_y", "m/s^2", "one step", 0.241, 0.062, 0.743, 0.70, 0.775, 6),
    Gain("specific_force_z", "m/s^2", "one step", 0.121, 0.12, 0.008, -0.02, 0.03, 6),
    Gain("angular_acceleration_x", "rad/s^2", "one step", 0.90, 0.91, -0.011, -0.03, -0.002, 6),
    Gain("velocity_x", "m/s", "1 s", 0.211, 0.031, 0.853, 0.82, 0.88, 6),
    Gain("velocity_y", "m/s", "1 s", 0.214, 0.033, 0.846, 0.81, 0.875, 6),
    Gain("position_x", "m", "1 s", 0.102, 0.014, 0.863, math.nan, math.nan, 2),
)
SCORES = (
    Score("linear_rotor_drag", 0.93, 812.4, 0.987, True),
    Score("quadratic_body_drag", 0.86, 790.1, 0.012, True, "less likely: fits fast circles only"),
    Score("steady_wind", 0.02, -4.1, 0.0006, True),
    Score("mass_error", 0.0, -6.0, 0.0001, True, "the same as thrust_coefficient_error in force"),
    Score("motor_lag", -0.01, -7.7, 0.0, True),
    Score("ground_effect", math.nan, math.nan, 0.0, False, "never below two rotor diameters"),
)
PRECHECKS = (
    Finding("stamps", "info", "circle_1", "position: 2 of 3000 stamps repeat, dropped"),
    Finding("gap", "warning", "circle_2", "position: silent for 0.31 s", 11.2, 11.51, "position"),
    Finding("crash", "fault", "circle_3", "accel: 2.5 g, then upside down; set apart", 25.0, 28.5,
            "accel"),
)  # fmt: skip
TOLERANCES = {"mass_error.fraction": 0.015, "thrust_scatter.deviation": 0.01, "cog_offset.x": 5e-4}


def leftover() -> Leftover:
    """Return a spring to a place, as three flights leave it."""
    rng = np.random.default_rng(9)
    samples = []
    for k in range(3):
        place, velocity = (np.cumsum(rng.standard_normal((120, 3)), axis=0) / 10 for _ in "ab")
        state = dict(zip("xyzuvw", [*place.T, *velocity.T], strict=True))
        state |= {"yaw": velocity[:, 0], "thrust": 12.0 + velocity[:, 1]}
        state["t"] = np.arange(120) * 0.24
        turn = np.broadcast_to(np.eye(3), (120, 3, 3))
        body = -0.5 * place + 0.1 * rng.standard_normal(place.shape)
        samples.append(LeftoverSamples(f"circle_{k + 1}", "force", state, turn, body))
    return Leftover((Dependence("force", "x", "map", 0.4),), {"force": 0.7}, tuple(samples))


EXPERIMENT = Experiment(
    ("mass_error", "thrust_coefficient_error"),
    "Force gives only the ratio of the two: weigh the vehicle, or hang 100 g under it and hover.",
)
SUMMARY = (
    "The flights call for linear rotor drag of 0.283 N s/m (0.276 to 0.290). With it the error in "
    "force falls by 75 % in x and 74 % in y on flights that were held out."
)
NOTES = (
    "d_z is not told from zero: no flight climbs faster than 0.4 m/s.",
    "No rotor speeds in circle_4: thrust was taken from the commands.",
)


def sample(verdict: str = "named", *, flights: int = 4, seconds: float = 30.0) -> Diagnosis:
    """Return a diagnosis with the verdict asked for."""
    extended = verdict in ("named", "partly_explained")
    causes = {"set": (MASS_ERROR, THRUST_ERROR), "named": (CAUSE,), "partly_explained": (CAUSE,)}
    members = ("mass_error", "thrust_coefficient_error") if verdict == "set" else ()
    notes = []
    for i in range(flights):
        name, used = f"circle_{i + 1}", seconds - 3.5 * (i == 2)
        sensors = ("mocap", ("gyro", "accel", "rotor_speed")) if i % 2 else ("imu", ())
        notes.append(FlightSummary(name, f"lab/{name}.mcap (MCAP)", seconds, used, *sensors))
    return Diagnosis(
        verdict=verdict,
        causes=causes.get(verdict, ()),
        set=members,
        separating_experiment=EXPERIMENT if verdict == "set" else None,
        gain=GAIN if extended else (),
        prechecks=PRECHECKS,
        candidates=SCORES,
        flights=tuple(notes),
        residuals=residuals(flights, seconds, extended),
        confidence=0.987 if extended else 0.93,
        summary=SUMMARY if extended else f"Made-up summary of a verdict '{verdict}'.",
        notes=NOTES,
        model="vehicle of the suite (S500, Conf. 13)",
        seconds=3.7,
        tolerances=TOLERANCES,
    )
