"""Flies the course of `tombo_benchmarks.peers` with rotorpy. Runs in rotorpy's own environment.

    python rotorpy_course.py ORDER.json

Physics and controller step by step; or its whole simulation, with IMU and motion capture. Its
batches need PyTorch and are not flown.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from peer_worker import Order, read_order, serve, timed
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.estimators.nullestimator import NullEstimator
from rotorpy.sensors.external_mocap import MotionCapture
from rotorpy.sensors.imu import Imu
from rotorpy.simulate import simulate
from rotorpy.vehicles.multirotor import Multirotor
from rotorpy.wind.default_winds import NoWind
from rotorpy.world import World

Array = npt.NDArray[np.float64]


class Course:
    """The set points as a trajectory of rotorpy."""

    def __init__(self, order: Order) -> None:
        self.rows = np.array(order["set_points"])
        self.period = order["set_point_ticks"] * order["step_s"]

    def update(self, t: float) -> dict[str, Any]:
        """Return the set point at a time, held until the next."""
        last = len(self.rows) - 1
        row = self.rows[int(min((t + 1e-9) / self.period, last))]
        return {
            "x": row[0:3], "x_dot": row[3:6], "x_ddot": row[6:9], "x_dddot": np.zeros(3),
            "x_ddddot": np.zeros(3), "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0,
        }  # fmt: skip


def vehicle_of(order: Order) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return rotorpy's parameters of the vehicle, and its state in hover."""
    ixx, iyy, izz = order["inertia"]
    arms = zip(order["arm_x"], order["arm_y"], strict=True)
    four_hover = 4.0 * order["hover_speed"]
    parameters = {
        "mass": order["mass"], "Ixx": ixx, "Iyy": iyy, "Izz": izz, "Ixy": 0.0, "Ixz": 0.0,
        "Iyz": 0.0, "num_rotors": 4,
        "rotor_pos": {f"r{i + 1}": np.array([x, y, 0.0]) for i, (x, y) in enumerate(arms)},
        "rotor_directions": -np.array(order["spin"]),
        "k_eta": order["k_thrust"], "k_m": order["k_torque"],
        "k_d": order["drag"][0] / four_hover, "k_z": order["drag"][2] / four_hover,
        "k_h": 0.0, "k_flap": 0.0, "c_Dx": 0.0, "c_Dy": 0.0, "c_Dz": 0.0,
        "tau_m": order["motor_time_constant"], "rotor_speed_min": 0.0,
        "rotor_speed_max": order["rotor_speed_max"], "motor_noise_std": 0.0,
    }  # fmt: skip
    state = {
        "x": np.array(order["set_points"][0][:3]), "v": np.zeros(3), "w": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]), "wind": np.zeros(3),
        "rotor_speeds": np.full(4, order["hover_speed"]),
    }  # fmt: skip
    return parameters, state


def made(order: Order) -> tuple[Multirotor, SE3Control, dict[str, Any]]:
    """Return vehicle, controller and state in hover."""
    parameters, state = vehicle_of(order)
    vehicle, pilot = Multirotor(parameters, state), SE3Control(parameters)
    vehicle.g = pilot.g = order["gravity"]
    vehicle.weight = np.array([0.0, 0.0, -order["mass"] * order["gravity"]])
    return vehicle, pilot, state


def main() -> None:
    """Answer orders."""
    order = read_order()
    step_s = order["step_s"]

    def fly(count: int, ticks: int) -> dict[str, Any]:
        """Fly one vehicle with physics and controller."""
        vehicle, pilot, state = made(order)
        course = Course(order)

        def steps() -> int:
            nonlocal state
            for k in range(ticks):
                goal = course.update(k * step_s)
                state = vehicle.step(state, pilot.update(k * step_s, state, goal), step_s)
            return ticks

        answer = timed(steps)
        return answer | {"position": state["x"].tolist()}

    def fly_whole(count: int, ticks: int) -> dict[str, Any]:
        """Fly one vehicle in rotorpy's simulation, with its sensors and records."""
        vehicle, pilot, state = made(order)
        rate = round(1.0 / step_s)
        imu = Imu(p_BS=np.zeros(3), R_BS=np.eye(3), sampling_rate=rate)
        parts = (NoWind(), imu, MotionCapture(sampling_rate=rate), NullEstimator())
        world = World.empty((-3, 3, -3, 3, -3, 3))
        flown: dict[str, Any] = {}

        def steps() -> int:
            flown["records"] = simulate(
                world, state, vehicle, pilot, Course(order), *parts, ticks * step_s, step_s, 0.25,
                False, terminate=False,
            )  # fmt: skip
            return len(flown["records"][0]) - 1

        answer = timed(steps)
        return answer | {"position": flown["records"][1]["x"][-1].tolist()}

    def replay(commands: list[list[float]]) -> dict[str, Any]:
        """Fly rotor commands [rad/s], one a step, without a controller."""
        vehicle, _, state = made(order)
        for command in np.array(commands):
            state = vehicle.step(state, {"cmd_motor_speeds": command}, step_s)
        return {"position": state["x"].tolist()}

    serve({"fly": fly, "fly_whole": fly_whole, "replay": replay}, ["rotorpy", "numpy", "scipy"])


if __name__ == "__main__":
    main()
