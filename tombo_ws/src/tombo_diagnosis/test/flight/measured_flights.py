"""Short flights with something hidden in them, as a lab would measure them."""

from functools import cache

import numpy as np

from tombo_bag.flight import Flight, Series
from tombo_benchmarks.diagnosis.disturbances import set_disturbance
from tombo_benchmarks.diagnosis.flight_simulation import sensor_series
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.nominal import nominal_model, nominal_of
from tombo_dynamics.effects import REGISTRY
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import scenario_over

HEALTHY = {
    name: values
    for name, values in nominal_model().effects.items()
    if not (REGISTRY[name].contact or REGISTRY[name].vibration)
}
"""Knowledge of the model: drag and cushion, and how noisy a sound lab is."""
NOISES = ("mocap_noise", "imu_noise", "gusts", "thrust_scatter")
SILENT = {name: values for name, values in HEALTHY.items() if name not in NOISES} | {
    "mocap_latency": {"delay": 0.010}
}
"""The same without any chance."""
LENGTH = 15.0
"""s"""
BEGIN = 3.2
"""s: at height from here on."""
LIVELY = (
    [
        {"x": 1.2, "y": 0.3, "speed": 2.5, "acceleration": 4.0},
        {"x": -1.2, "y": -0.4},
        {"yaw": 1.8, "yaw_rate": 2.5},
        {"x": -0.5, "y": 1.0, "z": 0.45, "speed": 1.2},
        {"x": 0.9, "y": 1.0},
        {"x": 0.9, "y": -1.0, "z": 1.8, "speed": 1.6},
        {"yaw": -0.6},
        {"x": 0.0, "y": 1.1, "speed": 2.5},
        {"x": 0.0, "y": -1.1},
        {"x": 0.0, "y": 0.6, "z": 0.5, "speed": 1.5},
        {"x": 0.6, "z": 1.5},
    ],
    [
        {"y": -1.1, "speed": 2.5, "acceleration": 4.0},
        {"y": 1.1},
        {"yaw": -2.0, "yaw_rate": 2.5},
        {"x": 1.2, "y": 0.0, "z": 0.45, "speed": 1.2},
        {"x": -0.8, "y": 0.2},
        {"x": -1.0, "y": -0.6, "z": 1.9, "speed": 1.6},
        {"yaw": 0.5},
        {"x": 1.1, "speed": 2.5},
        {"x": -1.1},
        {"y": 0.8, "z": 0.5, "speed": 1.5},
        {"x": 0.5, "z": 1.4},
    ],
)
"""Three paces, turns, two heights: courses on which most effects show."""
SLOW = (
    [
        {"x": 0.4, "speed": 0.5, "acceleration": 1.0},
        *({axis: place} for place in (0.4, -0.4) for axis in ("y", "x")),
        {"y": 0.4},
        {"x": 0.0},
    ],
)
"""So slow that drag says nothing, at one heading: without an IMU wind is as a tilted world."""
AIRBORNE = 0.4
"""m"""


def simulated_log(flown: Flight, imu: bool, rpm: bool) -> Flight:
    """Return a simulated flight as a log with these sensors."""
    series, t = sensor_series(flown, imu, rpm), flown.t
    poses = flown["/mocap/pose"]["position"]
    air = np.flatnonzero(poses.values[:, 2] > AIRBORNE)
    begin, end = float(poses.t[air[0]]) + 0.3, float(poses.t[air[-1]])
    ground = ((-1.0, begin), (end, float(t[-1]) + 1.0))
    return Flight.measured("simulated", "simulated", series, exclude=ground)


def scenario(effects, course=LIVELY[0], length=LENGTH):
    return scenario_over(
        {
            "reaction": {"name": "none"},
            "duration": length,
            "propeller": {"conf": 13, "law": "repaired"},
            "control": {"velocity_max_xy": 3.5, "velocity_max_z": 1.5},
            "effects": {name: dict(values) for name, values in effects.items()},
            "mission": {"takeoff_time": 0.3, "height": 1.2, "climb_speed": 1.2,
                        "approach_time": 2.2, "land_time": 3000.0, "course": course},
        },
        "short",
    )  # fmt: skip


@cache
def nominal(silent=False):
    return nominal_of(scenario(SILENT if silent else HEALTHY), "the tests' nominal model")


def with_hidden(hidden, base=None):
    """Return effects, updated with the hidden ones: effect → parameter → value."""
    effects = {name: dict(values) for name, values in (base or HEALTHY).items()}
    for name, values in hidden.items():
        effects[name] = {**effects.get(name, {}), **values}
    return effects


def fly(effects, course=LIVELY[0], seed=1, length=LENGTH, draws=None, disturbance=None):
    def prepare(plant):
        if draws is not None:
            plant.draws = draws
        if disturbance is not None:
            set_disturbance(plant, disturbance[0], *disturbance[1:])

    return fly_scenario(scenario(effects, course, length), seed, prepare=prepare)


def as_log(flown, name="flight 1", sensors="imu_rpm", begin=BEGIN, true_poses=False):
    """Return the sensors' samples; `true_poses`: at every tick, and without any error."""
    t = flown.t
    log = simulated_log(flown, imu=sensors.startswith("imu"), rpm=sensors.endswith("rpm"))
    series = dict(log.series)
    if true_poses:
        series["position"] = Series(t, flown.log["position"])
        series["attitude"] = Series(t, flown.log["attitude"])
    low = np.flatnonzero((flown.log["position"][:, 2] < 0.3) & (t > begin))
    end = float(t[low[0]]) - 0.2 if low.size else float(t[-1])
    return Flight.measured(name, "simulated", series, exclude=((-1.0, begin), (end, t[-1] + 1.0)))


ROTOR_DRAWS = np.array([1.1, -1.3, 0.6, -0.8, 0.0, 0.0, 0.0, 0.0])
"""The propellers of the vehicle that flies."""


def logs(
    hidden=None, seed=1, count=2, sensors="imu_rpm", courses=LIVELY, draws=ROTOR_DRAWS, **more
):
    """Return flights of one vehicle with something hidden in them."""
    effects = with_hidden(hidden or {})
    flown = [
        fly(effects, courses[i % len(courses)], 100 * seed + i, draws=draws, **more)
        for i in range(count)
    ]
    return [as_log(each, f"flight {i + 1}", sensors) for i, each in enumerate(flown)]


def tracks(*args, **more):
    return [track_of(log) for log in logs(*args, **more)]
