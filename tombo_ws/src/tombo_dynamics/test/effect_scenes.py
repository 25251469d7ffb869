"""Scenes in which an effect shows, and everything that can be seen of them.

An effect that is new flies in the free scene; give it one of its own here only if it needs more.
"""

import math
from functools import cache

import numpy as np
from one_vehicle import NOISE, Vehicle
from scipy.spatial.transform import Rotation

from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.effects.compose import apply_imu, apply_mocap, null_theta, pack_theta
from tombo_dynamics.vehicle import ARM_X, ARM_Y

TICKS = 80
SCENE = {"contact_force": "frame", "blade_strike": "blade", "propeller_wear": "blade"}
CONTEXT = {
    "propeller_wear": {"blade_strike": {"peak_force": 80.0, "recovery_time": 0.3, "slant": 0.5,
                                        "duration": 0.01}},
}  # fmt: skip
"""What has to be switched on for an effect to show."""
TRUTH = {"mocap_dropouts": {"probability": 0.3}, "blade_strike": {"duration": 0.0085}}
"""Values to try where the typical one is too rare for a short scene, or ends on a tick."""
BASE = {"linear_rotor_drag": {"d_xy": 0.2, "d_z": 0.1}}
SEEN = ("wind", "efficiency", "target", "speed", "fold", "damage", "strike", "contact", "wrench",
        "inertial", "body")  # fmt: skip


def typical(name):
    """Return a value for each parameter that differs from null and is within its bounds."""
    values = {}
    for p in REGISTRY[name].theta:
        value = TRUTH.get(name, {}).get(p.name, p.typical)
        values[p.name] = value if value != p.null else p.null + 0.05 * (p.bounds[1] - p.null)
    return values


def nulls(name):
    return {p.name: p.null for p in REGISTRY[name].theta}


def _place(kind):
    """Return the pose, and a pole that nothing, the arm's end or the blade's tip touches."""
    position = np.array([0.2, -0.1, 0.26])
    attitude = Rotation.from_euler("ZYX", [0.3, 0.04, -0.06])
    arm = attitude.apply([0.24 * ARM_X[2], 0.24 * ARM_Y[2], 0.0])
    radius = 0.1
    along = {"free": 0.0, "frame": radius + 0.02 - 0.004, "blade": radius + 0.1111 - 0.0008}[kind]
    pole = (position + arm + along * arm / np.linalg.norm(arm))[:2]
    return position, attitude.as_quat(), (*pole, radius if along else 0.0, 3.0)


@cache
def _noise():
    return np.random.default_rng(7).standard_normal((TICKS, NOISE))


def observe(name, values):
    """Fly the scene of effect `name` with parameters `values`; return a row a tick.

    A row holds all that physics, sensors and mocap have come to; the same function serves to
    simulate and to fit.
    """
    position, attitude, pole = _place(SCENE.get(name, "free"))
    others = {k: v for k, v in (BASE | CONTEXT.get(name, {})).items() if k != name}
    v = Vehicle(
        theta=pack_theta(others | {name: values}), position=position, attitude=attitude,
        velocity=(0.5, 0.3, -0.1), rates=(0.4, -0.6, 0.8), obstacle=pole, speed=450.0,
        draws=np.array([0.7, -1.1, 0.4, 1.6, 0.2, -0.5, 1.0, -0.3]),
    )  # fmt: skip
    noise = _noise()
    rows = []
    for k in range(TICKS):
        v["command"] = 450.0 + 80.0 * np.sin(0.07 * k + np.array([0.0, 1.0, 2.5, 4.0]))
        v.begin(noise[k])
        v["imu"][:3], v["imu"][3:] = v.rates, v["wrench"][:3] / v.mass
        apply_imu(v.m, noise[k], v.theta)
        v["mocap"][:3], v["mocap"][3:7] = v.position, v["body"][6:10]
        v["mocap"][7:9] = v["mocap"][10] = 0.0
        v["mocap"][9] = max(v["mocap"][9] - 5e-3, 0.0)
        apply_mocap(v.m, noise[k], v.theta)
        voltage = v["supply"][2:]  # charge and current are bookkeeping of the battery's effect
        rows.append(np.concatenate([*(v[part] for part in (*SEEN, "imu", "mocap")), voltage]))
        v.finish(noise[k])
    return np.array(rows)


def busy_memory():
    """Return a vehicle in the middle of a flight, where every part holds something."""
    v = Vehicle(
        theta=null_theta(), position=(0.3, 0.2, 0.5), velocity=(1.0, 0.5, 0.2), speed=480.0,
        attitude=Rotation.from_euler("ZYX", [0.5, 0.1, -0.1]).as_quat(), rates=(0.2, 0.1, -0.4),
        draws=np.linspace(-1.5, 1.5, 8),
    )  # fmt: skip
    v.fly(0.02, lambda k: 480.0 + 10.0 * k * np.array([1.0, -1.0, 0.5, 0.2]))
    v["wind"] = [0.4, 0.3, -0.1]
    v["gust"] = 0.0
    v["efficiency"] = [0.9, 1.0, 1.1, 0.8]
    v["target"] = v["command"]
    v["delay"].reshape(-1, 4)[int(v["clock"][0]) % 64] = v["command"]
    v["imu"] = [0.1, 0.2, 0.3, 1.0, 2.0, 9.0]
    v["mocap"][:8] = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, math.sqrt(0.86), 0.01]
    v["wrench"] = [0.1, 0.2, 12.0, 0.01, 0.02, 0.03]
    return v
