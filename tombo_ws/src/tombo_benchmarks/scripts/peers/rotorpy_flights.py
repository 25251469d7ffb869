"""Flies rotorpy's Hummingbird and writes what a laboratory would record. Runs in its own venv.

    python rotorpy_flights.py ORDER.json

The order: {"folder": where to write, "seed": n, "parameters": {rotorpy's name: factor},
"wind": [east, north] m/s, "marker": [x, y, z] m, "imu": [x, y, z] m, "late": s, "bias": m/s^2}.
Three flights, CSV: rotorpy's figures Lissajous (flat and slanted) and minimum snap.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.trajectories.lissajous_traj import TwoDLissajous
from rotorpy.trajectories.minsnap import MinSnap
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from scipy.spatial.transform import Rotation

Array = npt.NDArray[np.float64]
Order = dict[str, Any]
STEP_S, SECONDS = 0.005, 20.0
GRAVITY = 9.81
HEADER = "t,x,y,z,qx,qy,qz,qw,seen,wx,wy,wz,ax,ay,az,n1,n2,n3,n4,c1,c2,c3,c4"
"""Rotors as rotorpy counts them: front left, front right, rear right, rear left."""


def main(order: Order) -> None:
    """Fly all courses of an order."""
    rng = np.random.default_rng(order["seed"])
    true = dict(quad_params)
    for name, factor in order.get("parameters", {}).items():
        true[name] = true[name] * factor
    for number, course in enumerate(courses(rng)):
        rows = fly(true, course, np.array([*order.get("wind", [0.0, 0.0]), 0.0]))
        path = Path(order["folder"]) / f"flight_{number + 1}.csv"
        write(path, rows, order, rng)


def courses(rng: np.random.Generator) -> list[Any]:
    """Return courses in a hall of 4 m x 4 m."""
    points = np.array([[0.0, 0.0, 1.2], *rng.uniform([-1.5, -1.5, 0.6], [1.5, 1.5, 2.0], (9, 3))])
    with contextlib.redirect_stdout(io.StringIO()):
        snap = MinSnap(points, rng.uniform(-1.5, 1.5, 10), v_avg=1.4, v_max=3.0, verbose=False)
    yaw = Turning(0.5)
    return [
        TwoDLissajous(1.5, 1.2, 1.2, 2.1, 0.3, height=1.2, yaw_traj=yaw),
        snap,
        TwoDLissajous(1.2, 1.4, 1.9, 0.9, 0.8, height=0.9, yaw_traj=Turning(-0.8)),
    ]


class Turning:
    """Lets the heading turn steadily."""

    def __init__(self, rate: float) -> None:
        self.rate = rate

    def update(self, t: float, velocity: Array) -> dict[str, float]:
        """Return heading and its derivatives."""
        return {"yaw": self.rate * t, "yaw_dot": self.rate, "yaw_ddot": 0.0}


def fly(true: dict[str, Any], course: Any, wind: Array) -> Array:
    """Return rows of time, position, attitude, rates, specific force, rotors, commands."""
    at = course.update(0.0)["x"]
    weight = true["mass"] * GRAVITY / 4.0
    state = {
        "x": np.array(at, float), "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3), "wind": wind,
        "rotor_speeds": np.full(4, np.sqrt(weight / true["k_eta"])),
    }  # fmt: skip
    vehicle, pilot = Multirotor(true, state), SE3Control(quad_params)
    rows = []
    for k in range(int(SECONDS / STEP_S)):
        control = pilot.update(k * STEP_S, state, course.update(k * STEP_S))
        slope = vehicle.statedot(state, control, STEP_S)
        turn = Rotation.from_quat(state["q"])
        felt = turn.inv().apply(slope["vdot"] + [0.0, 0.0, GRAVITY])
        command = np.clip(
            control["cmd_motor_speeds"], true["rotor_speed_min"], true["rotor_speed_max"]
        )
        rows.append(np.concatenate([
            [k * STEP_S], state["x"], state["q"], state["w"], felt, slope["wdot"],
            state["rotor_speeds"], command,
        ]))  # fmt: skip
        state = vehicle.step(state, control, STEP_S)
        state["wind"] = wind
    return np.array(rows)


def write(path: Path, rows: Array, order: Order, rng: np.random.Generator) -> None:
    """Write a flight with the errors of a laboratory's sensors."""
    t, place, q, rates, felt, turning, rotors, commands = np.split(
        rows, np.cumsum([1, 3, 4, 3, 3, 3, 4]), axis=1
    )
    marker = Rotation.from_quat(q).apply(order.get("marker", [0.0] * 3))
    lever = np.tile(order.get("imu", [0.0] * 3), (len(t), 1))
    felt = felt + np.cross(turning, lever) + np.cross(rates, np.cross(rates, lever))
    felt = felt + [order.get("bias", 0.0), 0.0, 0.0] + 0.1 * rng.standard_normal(felt.shape)
    rates = rates + 0.005 * rng.standard_normal(rates.shape)
    place = place + marker + 0.0005 * rng.standard_normal(place.shape)
    shake = Rotation.from_rotvec(0.002 * rng.standard_normal((len(t), 3)))
    q = (Rotation.from_quat(q) * shake).as_quat()
    seen = t + order.get("late", 0.0)
    cells = [t, place, q, seen, rates, felt, rotors + rng.standard_normal(rotors.shape), commands]
    text = [HEADER]
    for k, row in enumerate(np.hstack(cells)):
        texts = [f"{x:.7g}" for x in row]
        if k % 2:  # the motion capture at 100 Hz
            texts[1:9] = [""] * 8
        text.append(",".join(texts))
    path.write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
