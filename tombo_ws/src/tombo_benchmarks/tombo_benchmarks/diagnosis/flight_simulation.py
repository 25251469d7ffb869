"""Flights of a synthetic case: random courses, flown with the true model, with sensor faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from tombo_bag.flight import Flight, Series
from tombo_benchmarks.diagnosis.disturbances import set_disturbance
from tombo_benchmarks.diagnosis.flight_cases import COURSE_S, FlightCase
from tombo_benchmarks.diagnosis.log_recording import record_log
from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.scenario import Scenario, scenario_over

_BESIDES_S = 14.0
"""Duration of take-off, hover and turns, which the course does not contain."""
_CLIMB = 1.5
"""m/s"""
_RPM_NOISE, _RPM_STEP = 1.5, 0.5
"""rad/s: noise and resolution of the speed sensors, which no effect describes."""
_VIBRATION = 0.02
"""m/s^2: coloured noise of the accelerometer, as of a loose mount."""
_STAMP_JITTER = 2e-4
"""s"""
_VOLTAGE_NOISE = 0.01
"""V"""


def sensor_series(flown: Flight, imu: bool, rpm: bool) -> dict[str, Series]:
    """Return what these sensors measured in a simulated flight."""
    t = flown.t
    series = {
        **flown["/mocap/pose"],
        "rotor_command": Series(t, flown.log["rotor_command"].copy()),
        "voltage": Series(t[::100], flown.log["battery"][::100, 2:3]),
    }
    if imu:
        series |= {name: Series(t, flown.log[name].copy()) for name in ("gyro", "accel")}
    if rpm:
        series["rotor_speed"] = Series(t, flown.log["rotor_speed"].copy())
    return series


def course(rng: np.random.Generator, length_s: float = COURSE_S) -> list[dict[str, float]]:
    """Return a random course inside 4 m x 4 m x 2.2 m, with turns, three paces and two heights."""
    points: list[dict[str, float]] = []
    time = 0.0
    x, y, z, yaw = 0.0, 0.0, 1.2, 0.0
    while time < length_s:
        kind = rng.choice(["leg", "leg", "leg", "turn", "shuttle", "low"])
        speed = float(rng.choice([0.7, 1.4, 2.5]))
        pace = {"speed": speed, "acceleration": float(rng.uniform(1.0, 4.0))}
        if kind == "turn":
            yaw += float(rng.uniform(-3.0, 3.0))
            points.append({"yaw": yaw, "yaw_rate": 1.5, "hold": 0.3})
            time += 2.5
        elif kind == "shuttle":
            for side in (0.8, -0.8, 0.0):
                points.append({"x": x, "y": y + side, "z": z, "yaw": yaw, **pace})
                time += 0.8 / speed + 1.0
        else:
            goal = rng.uniform(-2.0, 2.0, 2)
            before = z
            height = float(rng.uniform(0.4, 0.6) if kind == "low" else rng.uniform(0.8, 2.2))
            way = float(np.hypot(goal[0] - x, goal[1] - y))
            x, y, z = float(goal[0]), float(goal[1]), height
            steep = abs(z - before) / max(way, 1e-3)
            pace["speed"] = min(speed, 0.9 * _CLIMB * float(np.hypot(1.0, 1.0 / max(steep, 1e-3))))
            points.append({"x": x, "y": y, "z": z, "yaw": yaw, **pace})
            time += way / pace["speed"] + pace["speed"] / pace["acceleration"]
    return points


def _scenario(case: FlightCase, points: list[dict[str, float]]) -> Scenario:
    return scenario_over(
        {
            "reaction": {"name": "none"},
            "duration": case.course_s + _BESIDES_S,
            "control": {"velocity_max_xy": 3.5, "velocity_max_z": _CLIMB},
            "effects": {name: dict(values) for name, values in case.effects.items()},
            "mission": {
                "takeoff_time": 0.5, "height": 1.2, "climb_speed": 1.0, "approach_time": 2.5,
                "land_time": 3000.0, "course": points,
            },
        },
        "blind",
    )  # fmt: skip


def true_draws(case: FlightCase) -> Array:
    """Return the vehicle's draws (8): the same propellers in all of its flights."""
    return np.random.default_rng([*case.seed, 2]).standard_normal(8)


def simulate_case(case: FlightCase) -> list[Flight]:
    """Return the measured flights of a case."""
    streams = np.random.SeedSequence([*case.seed, 1]).spawn(case.flights)
    draws = true_draws(case)
    space = Workspace()
    logs = []
    for number, stream in enumerate(streams):
        rng = np.random.default_rng(stream)

        def prepare(plant: Plant) -> None:
            plant.draws = draws
            if case.disturbance:
                set_disturbance(plant, case.hidden[0], *case.disturbance)

        scenario = _scenario(case, course(rng, case.course_s))
        flown = fly_scenario(scenario, int(rng.integers(2**31)), workspace=space, prepare=prepare)
        logs.append(measured(flown, f"flight {number + 1}", case.formulation, rng))
    return logs


def fly_case(case: FlightCase, folder: Path) -> list[Path]:
    """Fly a case and record its flights in a folder; return the files."""
    paths = []
    for log in simulate_case(case):
        paths.append(folder / f"{log.name.replace(' ', '-')}.mcap")
        record_log(log, paths[-1])
    return paths


def measured(flown: Flight, name: str, formulation: str, rng: np.random.Generator) -> Flight:
    """Return the log of a flight as the sensors of a lab would measure it."""
    t = flown.t
    series = sensor_series(flown, formulation.startswith("imu"), formulation.endswith("rpm"))
    stamps = series["position"].t
    stamps = stamps + _STAMP_JITTER * rng.standard_normal(stamps.size)
    for channel in ("position", "attitude"):
        series[channel] = replace(series[channel], t=stamps)
    volts = series["voltage"].values
    noisy = volts + _VOLTAGE_NOISE * rng.standard_normal(volts.shape)
    series["voltage"] = Series(t[::100], noisy)
    if "accel" in series:
        shake = _coloured(rng, t.size, 3, 0.05) * _VIBRATION
        series["accel"] = Series(t, series["accel"].values + shake)
    if "rotor_speed" in series:
        speed = series["rotor_speed"].values
        noisy = speed + _RPM_NOISE * rng.standard_normal(speed.shape)
        series["rotor_speed"] = Series(t, np.round(noisy / _RPM_STEP) * _RPM_STEP)
    return Flight.measured(name, "blind benchmark", series)


def _coloured(rng: np.random.Generator, count: int, width: int, time: float) -> Array:
    """Return (count, width) noise of unit deviation, correlated over `time` seconds."""
    decay = float(np.exp(-1e-3 / time))
    drive = rng.standard_normal((count, width)) * np.sqrt(1.0 - decay**2)
    return np.asarray(lfilter([1.0], [1.0, -decay], drive, axis=0))
