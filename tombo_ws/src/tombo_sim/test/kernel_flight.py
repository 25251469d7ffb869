"""A flight with the fused kernel alone: all cores, hover or a short hop."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from core_calls import Estimator, Mission, begin_in_flight
from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams, ReactionLimits
from tombo_collision.reaction_core import ReactionCore
from tombo_collision.reactions.bounce import Bounce
from tombo_control.autopilot import Autopilot, new_autopilot, restart_estimate
from tombo_control.controller_core import ControllerCore
from tombo_control.estimator import store_history
from tombo_control.params import ControlParams, EstimatorParams, InputLimits
from tombo_control.planning.leg import hold_leg, store_leg
from tombo_control.planning.mission import MissionParams
from tombo_control.planning.mission_memory import MissionLimits
from tombo_dynamics.effects.compose import new_plant, pack_theta
from tombo_dynamics.messages import Phase
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.records import numbers
from tombo_dynamics.rigid_body import begin_flight
from tombo_dynamics.rotor_maps import rotor_maps, speed_for_thrust
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_dynamics.vehicle import VehicleParams
from tombo_sim.flight_loop import (
    REACTION,
    fly,
    new_published,
    one_flight,
    published_by,
    shared_by,
    step_in_python,
)
from tombo_sim.kernel import new_log
from tombo_sim.sensing import in_order_of_arrival

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
    """Results of a flight: the log by names, the mocap table, both memories."""

    log: tuple
    mocap: np.ndarray
    delivered: list
    plant: np.void
    a: Autopilot
    columns: dict = field(init=False)

    def __post_init__(self):
        self.columns = self.log._asdict()

    def __getitem__(self, name):
        return self.columns[name]

    def begins_like(self, other):
        """Return whether the log is the beginning of another's, to the last bit."""
        return all((b[: len(a)] == a).all() for a, b in zip(self.log, other.log, strict=True))


def memories(effects, position=(0.0, 0.0, 1.5), yaw=0.2, obstacle=(0.0, 0.0, 0.0, 0.0), seed=0):
    """Return plant, autopilot and theta of a vehicle in hover, told to go half a metre ahead."""
    theta = pack_theta(effects)
    plant = new_plant(VEHICLE)
    attitude = np.array([0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])
    plant.state.position = position
    plant.state.attitude = attitude
    plant.obstacle = tuple(obstacle)
    plant.draws = np.random.default_rng(seed + 1).standard_normal(8)
    begin_flight(plant, np.zeros(NOISE), theta, TICK)
    hover = speed_for_thrust(maps(), VEHICLE.hover_thrust())
    plant.rotor_speed = plant.rotor_command = hover
    plant.past_commands[:] = hover
    a = new_autopilot(ControlParams(), EstimatorParams(), VEHICLE, np.array(position), attitude)
    a.mode_asked = Phase.HOVER
    target = np.add(position, (0.5, 0.1, -0.1))
    store_leg(a.leg, hold_leg(tuple(target.tolist()), 0.0, yaw))
    a.setpoint.yaw = yaw
    return plant, a, theta


def hovering_cores(plant, a):
    """Return cores that hover where the plant is, told as `a` is."""
    body = numbers(plant.state)
    estimator = Estimator(EstimatorParams(), VEHICLE)
    restart_estimate(estimator.autopilot, body[:3], np.zeros(3), body[6:10])
    store_history(estimator.autopilot.state, estimator.autopilot.history, EPOCH_NS // TICK_NS)
    estimator.autopilot.mocap_time = EPOCH_NS * 1e-9
    estimator.memory.running = True
    estimator.memory.next_tick = EPOCH_NS // TICK_NS
    mission = Mission(MissionParams(approach_time=3600.0, land_time=3600.0), MissionLimits())
    mission.memory.mode, mission.memory.leg = Phase.HOVER, a.leg
    mission.memory.settled_since_s = np.inf
    mission.memory.settled_s = mission.memory.course_s = np.nan
    mission.memory.has_estimate = True
    mission.estimate(body[:3], np.zeros(3), EPOCH_NS)
    controller = ControllerCore(ControlParams(), VEHICLE, InputLimits(), maps())
    controller.autopilot.as_array()[0] = a
    begin_in_flight(controller)
    controller.memory.has_setpoint = True
    controller.memory.setpoint["phase"] = Phase.HOVER
    controller.memory.setpoint["position"] = a.leg.start
    controller.memory.setpoint["yaw"] = a.leg.yaw
    controller.memory.setpoint_ns = controller.memory.pose_ns = EPOCH_NS
    controller.memory.estimate_ns = EPOCH_NS - 1
    reaction = ReactionCore(Bounce(), ReactionLimits())
    return (
        estimator, DetectorCore(DetectorParams(trigger="none")), reaction, mission, controller
    )  # fmt: skip


def fly_kernel(effects=None, seconds=1.0, seed=0, chunk=10**9, block=10**9, tick_noise=None,
               mocap_noise=None, **where):  # fmt: skip
    """Fly; `chunk`: ticks that a call may fly, `block`: rows of noise that it is given."""
    plant, a, theta = memories(effects or {}, seed=seed, **where)
    ticks = round(seconds / TICK)
    captures = capture_ticks(seconds)
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((ticks, NOISE)) if tick_noise is None else tick_noise
    normals = rng.standard_normal((captures.size, NOISE)) if mocap_noise is None else mocap_noise
    log = new_log(ticks)
    for column in log:
        column[:] = np.nan
    cores = hovering_cores(plant, a)
    flights = one_flight(plant, theta, (captures, normals), cores, new_published(1, ticks))
    shared = shared_by(maps(), cores, log)
    flights.progress["end"] = ticks
    while (k := int(flights.progress["tick"][0])) < ticks:
        base = flights.base[0] = k - k % block
        flights = flights._replace(noise=drawn[None, base : base + block].copy())
        if fly(flights, shared, 0, min(k + chunk, base + block, ticks)):
            step_in_python(flights, 0, cores[REACTION])
    mocap = flights.entries[0]
    ticks = published_by(flights, 0)["/detector/status"]["tick"].tolist()
    delivered = list(zip(ticks, in_order_of_arrival(mocap).tolist(), strict=True))
    return Flight(log, mocap, delivered, plant, cores[-1].autopilot)


def motion_of(flight):
    """Return the motion of a flight, a row a tick, as the inverse simulation takes it."""
    state = [flight[n] for n in ("position", "velocity", "attitude", "rates")]
    return np.hstack([*state, np.gradient(flight["rates"], TICK, axis=0)])


def commands_of(flight):
    """Return what acts in each tick: the command of the tick before."""
    return np.vstack([flight["rotor_command"][:1], flight["rotor_command"][:-1]])


def vehicle_of(seed):
    """Return the plant, with its draws, that a flight of that seed flew."""
    plant = new_plant(VEHICLE)
    plant.draws = np.random.default_rng(seed + 1).standard_normal(8)
    return plant


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
