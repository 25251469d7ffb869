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
from tombo_dynamics.effects.downwash import set_jets
from tombo_dynamics.vehicle import ARM_X, ARM_Y

TICKS = 80
SCENE = {
    "contact_force": "frame", "blade_strike": "blade", "propeller_wear": "blade",
    "hanging_load": "high", "accel_range": "blade",
}  # fmt: skip
STRIKE = {"peak_force": 80.0, "recovery_time": 0.3, "slant": 0.5, "duration": 0.01}
CONTEXT = {name: {"blade_strike": STRIKE} for name in ("propeller_wear", "accel_range")}
"""Conditions under which an effect shows."""
TRUTH = {
    "mocap_dropouts": {"probability": 0.3}, "blade_strike": {"duration": 0.0085},
    "steady_wind": {"frequency": 9.0},
}  # fmt: skip
"""Values to try where the typical one is too rare or too slow for a short scene, or ends on a
tick."""
BASE = {"linear_rotor_drag": {"d_xy": 0.2, "d_z": 0.1}}
STATE = (
    "wind", "efficiency", "rotor_target", "rotor_speed", "fold", "damage", "strike_force",
    "strike_moment", "force", "moment", "inertia", "centre_of_gravity", "gyro", "accel",
)  # fmt: skip


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
    position = np.array([0.2, -0.1, 2.0 if kind == "high" else 0.26])
    attitude = Rotation.from_euler("ZYX", [0.3, 0.04, -0.06])
    arm = attitude.apply([0.24 * ARM_X[2], 0.24 * ARM_Y[2], 0.0])
    radius = 0.1
    along = {
        "free": 0.0,
        "high": 0.0,
        "frame": radius + 0.02 - 0.004,
        "blade": radius + 0.1111 - 0.0008,
    }[kind]
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
    set_jets(v.plant, [(position + np.array([0.1, 0.0, 0.5]), 12.0)])
    noise = _noise()
    rows = []
    for k in range(TICKS):
        v.plant.rotor_command = 450.0 + 80.0 * np.sin(0.07 * k + np.array([0.0, 1.0, 2.5, 4.0]))
        v.begin(noise[k])
        v.plant.gyro, v.plant.accel = v.rates, v.plant.force / v.mass
        apply_imu(v.plant, noise[k], v.theta)
        v.plant.mocap = (tuple(v.position), tuple(v.body[6:10]), 5e-3, 0.0, 0.0, False)
        apply_mocap(v.plant, noise[k], v.theta)
        plant, contact, mocap = v.plant, v.plant.contact, v.plant.mocap
        scalars = [
            plant.mass, plant.motor_time_constant, plant.half_tick_decay, plant.tick_decay,
            mocap.latency, mocap.stamp_error, mocap.dropped, contact.touching, contact.rotor,
            plant.memories.mocap_dropouts.rest,
            plant.supply.voltage,  # charge and current: bookkeeping of the battery's effect
        ]  # fmt: skip
        vectors = [mocap.position, mocap.attitude, contact.force, contact.point]
        rows.append(np.concatenate([*(plant[name] for name in STATE), v.body, *vectors, scalars]))
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
    v.plant.wind = [0.4, 0.3, -0.1]
    v.plant.efficiency = [0.9, 1.0, 1.1, 0.8]
    v.plant.rotor_target = v.plant.rotor_command
    v.plant.past_commands[v.plant.ticks % 64] = v.plant.rotor_command
    v.imu = [0.1, 0.2, 0.3, 1.0, 2.0, 9.0]
    v.plant.mocap.position, v.plant.mocap.latency = [1.0, 2.0, 3.0], 0.01
    v.plant.mocap.attitude = [0.1, 0.2, 0.3, math.sqrt(0.86)]
    v.plant.force, v.plant.moment = [0.1, 0.2, 12.0], [0.01, 0.02, 0.03]
    return v
