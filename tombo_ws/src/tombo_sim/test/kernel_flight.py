"""A flight with the fused kernel alone: no detector, no mission, hover or a short hop."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from tombo_control.autopilot import HOVER, A, new_autopilot
from tombo_control.params import ControlParams, EstimatorParams
from tombo_dynamics.effects.compose import pack_theta
from tombo_dynamics.plant import new_plant, part
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.rigid_body import begin_flight
from tombo_dynamics.rotor_maps import rotor_maps, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams
from tombo_sim.kernel import MOCAP_WIDTH, fly
from tombo_sim.log_columns import COLUMNS, LOG_WIDTH

VEHICLE = VehicleParams()
NOISE = 9
TICK = 1e-3
RATE = 30.0


@cache
def maps():
    return rotor_maps(thrust_map(configuration(13)), VEHICLE)


def capture_ticks(seconds):
    ticks = np.round(np.arange(0.0, seconds, 1.0 / RATE) / TICK).astype(np.int64)
    return np.append(ticks, np.int64(2**62))


@dataclass
class Flight:
    """What a flight leaves behind: the log by names, the mocap table, both memories."""

    log: np.ndarray
    mocap: np.ndarray
    delivered: list
    m: np.ndarray
    a: np.ndarray
    columns: dict = field(init=False)

    def __post_init__(self):
        self.columns = {name: self.log[:, where] for name, where in COLUMNS.items()}

    def __getitem__(self, name):
        return self.columns[name]


def memories(effects, position=(0.0, 0.0, 1.5), yaw=0.2, obstacle=(0.0, 0.0, 0.0, 0.0), seed=0):
    """Return plant, autopilot and theta of a vehicle in hover, told to go half a metre ahead."""
    theta = pack_theta(effects)
    m = new_plant(VEHICLE)
    attitude = np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
    part(m, "body")[:3] = position
    part(m, "body")[6:10] = attitude
    part(m, "obstacle")[:] = obstacle
    part(m, "draws")[:] = np.random.default_rng(seed + 1).standard_normal(8)
    begin_flight(m, np.zeros(NOISE), theta, TICK)
    hover = speed_for_thrust(maps(), VEHICLE.hover_thrust())
    part(m, "speed")[:] = part(m, "command")[:] = hover
    part(m, "delay")[:] = hover
    a = new_autopilot(ControlParams(), EstimatorParams(), VEHICLE, np.array(position), attitude)
    a[A.mode] = HOVER
    target = np.add(position, (0.5, 0.1, -0.1))
    a[A.leg : A.leg + 10] = [*target, 0.0, 0.0, 0.0, 0.0, 1e6, 1.0, yaw]
    return m, a, theta


def fly_kernel(effects=None, seconds=1.0, seed=0, chunk=10**9, block=10**9, tick_noise=None,
               mocap_noise=None, **where):  # fmt: skip
    """Fly; `chunk`: ticks that a call may fly, `block`: rows of noise that it is given."""
    m, a, theta = memories(effects or {}, seed=seed, **where)
    ticks = round(seconds / TICK)
    captures = capture_ticks(seconds)
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((ticks, NOISE)) if tick_noise is None else tick_noise
    samples = captures.size
    poses = rng.standard_normal((samples, NOISE)) if mocap_noise is None else mocap_noise
    mocap = np.zeros((samples, MOCAP_WIDTH))
    log = np.full((ticks, LOG_WIDTH), np.nan)
    state = np.zeros(3, dtype=np.int64)
    delivered = []
    k = 0
    while k < ticks:
        base = k - k % block
        stop = min(k + chunk, base + block, ticks)
        k, row = fly(
            m, a, maps(), theta, drawn[base : base + block].copy(), poses, captures, mocap, state,
            log, base, k, stop,
        )  # fmt: skip
        if row >= 0:
            delivered.append((k - 1, row))
    return Flight(log, mocap, delivered, m, a)


NOISY = {
    "gusts": {"deviation": 0.5, "time": 0.5},
    "linear_rotor_drag": {"d_xy": 0.3, "d_z": 0.1},
    "imu_noise": {"gyro": 0.01, "accel": 0.3},
    "imu_bias": {"gyro_x": 0.01, "accel_y": 0.1},
    "mocap_noise": {"position": 0.001, "attitude": 0.002},
    "mocap_latency": {"delay": 0.012, "jitter": 0.004},
    "mocap_dropouts": {"probability": 0.05, "duration": 0.05},
    "command_delay": {"delay": 0.004},
    "battery_sag": {"resistance": 0.02, "discharge": 0.5},
    "ground_effect": {"strength": 1.0},
    "thrust_scatter": {"deviation": 0.03},
    "blade_strike": {"peak_force": 145.5, "recovery_time": 0.42, "slant": 0.4, "duration": 0.014},
    "propeller_wear": {"collisions": 3.0},
    "contact_force": {"stiffness": 6000.0, "damping": 25.0},
}
"""Everything at once."""
IN_THE_WAY = {"obstacle": (0.6, 0.3, 0.1, 3.0)}
"""A pole that the hop ends at."""
