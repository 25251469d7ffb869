"""Flies rotorpy's Hummingbird with something hidden, and writes logs. Runs in its own environment.

    python rotorpy_flights.py FOLDER [--cases 12] [--seed 0] [--hide mass]

`tombo benchmark foreign FOLDER` diagnoses them. It needs nothing of Tombo.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
STEP_S, GROWN_S, DURATION_S, FLIGHTS, POSE_STEPS = 0.005, 3.0, 20.0, 2, 2
LATENCY_S: Final = 0.010
JITTER_S: Final = 0.0005
"""From capture to arrival of a pose in good order: mean and standard deviation."""
NOISE: Final = np.repeat([0.0003, 0.001, 0.01, 0.1, 1.0], [3, 4, 3, 3, 4])
"""m, 1, rad/s, m/s^2, rad/s: of position, quaternion, gyro, accelerometer, rotor speeds."""
ROTORS: Final = {"front_right": 1, "rear_left": 3, "front_left": 0, "rear_right": 2}
"""Name in docs/effects.md → number here."""
HOVER: Final = float(np.sqrt(quad_params["mass"] * 9.81 / 4.0 / quad_params["k_eta"]))
"""rad/s"""
DRAG: Final = 4.0 * HOVER * quad_params["k_d"]
"""N s/m, of the healthy vehicle in hover."""
HIDDEN: Final = {
    "none": 0.0, "mass": 0.1, "drag": DRAG, "rotor": 0.15, "latency": 0.03, "wind": 1.5,
}  # fmt: skip
"""Condition → change that clearly matters: share, N s/m, share, s, m/s."""

LOG: Final = "t,capture,arrival,x,y,z,qx,qy,qz,qw,wx,wy,wz,ax,ay,az,n1,n2,n3,n4"
POSE_TIME: Final = "time: {column: capture, unit: s}, arrival: {column: arrival, unit: s}"
MAPPING: Final = f"""about: rotorpy
time: {{column: t, unit: s}}
channels:
  position: {{columns: [x, y, z], unit: m, {POSE_TIME}}}
  attitude: {{columns: [qx, qy, qz, qw], order: xyzw, {POSE_TIME}}}
  gyro: {{columns: [wx, wy, wz], unit: rad/s}}
  accel: {{columns: [ax, ay, az], unit: m/s^2}}
  rotor_speed: {{columns: [n2, n4, n1, n3], unit: rad/s}}
"""
VEHICLE: Final = f"""tombo_vehicle: 1
name: hummingbird
vehicle:
  mass: {{value: {quad_params["mass"]}, tolerance: 0.003}}
  inertia_xx: {quad_params["Ixx"]}
  inertia_yy: {quad_params["Iyy"]}
  inertia_zz: {quad_params["Izz"]}
  arm_length: 0.17
  rotor_height: 0.0
  rotor_inertia: 1.0e-8
  motor_time_constant: {quad_params["tau_m"]}
  rotor_speed_min: 0.0
  rotor_speed_max: {quad_params["rotor_speed_max"]}
propeller: {{k_thrust: {quad_params["k_eta"]}, k_torque: {quad_params["k_m"]}, radius: 0.1}}
effects:
  linear_rotor_drag: {{d_xy: {DRAG:.4g}, d_z: {4.0 * HOVER * quad_params["k_z"]:.4g}}}
  quadratic_body_drag: {{c_area: {2.0 * quad_params["c_Dx"] / 1.2041:.4g}}}
  translational_lift: {{k: {quad_params["k_h"] / (quad_params["k_eta"] * HOVER**2):.4g}}}
  mocap_latency: {{delay: {LATENCY_S}, jitter: {JITTER_S}}}
"""


class WeakMultirotor(Multirotor):
    """A vehicle with rotors that have lost thrust, and that turns without drag.

    In rotorpy the rotors' drag acts at the hubs and brakes each turn. The vehicle file can't say
    that, and the diagnosis would name it as unknown in every flight.
    """

    gains: Array = np.ones(4)

    def compute_body_wrench(self, rates: Array, speeds: Array, air: Array) -> tuple[Array, Array]:
        """Return force and moment in body axes [N, N m]."""
        reached = speeds * np.sqrt(self.gains)
        wrench: tuple[Array, Array] = super().compute_body_wrench(0.0 * rates, reached, air)
        return wrench


def truth_of(hide: str, rng: np.random.Generator) -> dict[str, float]:
    """Return "effect.parameter" → true value; 0.6 to 1.2 times the change that matters."""
    size = HIDDEN[hide] * float(rng.uniform(0.6, 1.2))
    way = float(rng.uniform(0.0, 2.0 * np.pi))
    return {
        "none": {}, "mass": {"mass_error.fraction": float(np.sign(np.sin(way))) * size},
        "drag": {"linear_rotor_drag.d_xy": DRAG + size},
        "rotor": {f"weak_propeller.{rng.choice(list(ROTORS))}": size},
        "latency": {"mocap_latency.delay": LATENCY_S + size},
        "wind": {"steady_wind.east": size * np.cos(way), "steady_wind.north": size * np.sin(way)},
    }[hide]  # fmt: skip


def fly(truth: dict[str, float], rng: np.random.Generator) -> Array:
    """Return rows in the columns of LOG."""
    true = dict(quad_params)
    true["mass"] = true["mass"] * (1.0 + truth.get("mass_error.fraction", 0.0))
    true["k_d"] = true["k_d"] * truth.get("linear_rotor_drag.d_xy", DRAG) / DRAG
    wind = np.array([*(truth.get(f"steady_wind.{p}", 0.0) for p in ("east", "north")), 0.0])
    size = rng.uniform([0.8, 0.8, 0.3, 0.6], [1.6, 1.6, 0.6, 1.2])
    rate, phase = rng.uniform(0.6, 1.4, 4), rng.uniform(0.0, 2.0 * np.pi, 4)

    def place(t: float) -> Array:
        """Return position and yaw on a Lissajous figure that grows out of the hover."""
        begun = np.clip(t / GROWN_S, 0.0, 1.0)
        share = begun**3 * (10.0 - 15.0 * begun + 6.0 * begun**2)
        return np.asarray(share * size * np.sin(rate * t + phase) + [0.0, 0.0, 3.0, 0.0])

    def goal(t: float) -> dict[str, Any]:
        """Return the set point: places and their derivatives by differences."""
        before, here, after = (place(t + step) for step in (-STEP_S, 0.0, STEP_S))
        pace, change = (after - before) / (2.0 * STEP_S), (after - 2.0 * here + before) / STEP_S**2
        return {
            "x": here[:3], "x_dot": pace[:3], "x_ddot": change[:3], "x_dddot": np.zeros(3),
            "x_ddddot": np.zeros(3), "yaw": here[3], "yaw_dot": pace[3], "yaw_ddot": change[3],
        }  # fmt: skip

    state: dict[str, Any] = {
        "x": place(0.0)[:3], "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3), "wind": wind, "rotor_speeds": np.full(4, HOVER),
    }  # fmt: skip
    vehicle, pilot = WeakMultirotor(true, state), SE3Control(quad_params)
    vehicle.gains = 1.0 - np.array(
        [truth.get(f"weak_propeller.{name}", 0.0) for name in sorted(ROTORS, key=ROTORS.get)]
    )
    latency = truth.get("mocap_latency.delay", LATENCY_S)
    rows = []
    for k in range(round(DURATION_S / STEP_S)):
        t = k * STEP_S
        control = pilot.update(t, state, goal(t))
        slope = vehicle.statedot(state, control, STEP_S)["vdot"] + [0.0, 0.0, 9.81]
        felt = Rotation.from_quat(state["q"]).inv().apply(slope)
        seen = np.concatenate([state[n] for n in ("x", "q", "w")] + [felt, state["rotor_speeds"]])
        seen += NOISE * rng.standard_normal(NOISE.size)
        rows.append([t, t, t + latency + JITTER_S * rng.standard_normal(), *seen])
        state = vehicle.step(state, control, STEP_S)
    return np.array(rows)


def write_case(folder: Path, hide: str, seed: list[int]) -> None:
    """Fly and write flight_*.csv, mapping.yaml, vehicle.yaml and truth.json."""
    rng = np.random.default_rng(seed)
    truth = truth_of(hide, rng)
    folder.mkdir(parents=True, exist_ok=True)
    for flight in range(FLIGHTS):
        lines = [LOG]
        for k, row in enumerate(fly(truth, rng)):
            cells = [f"{value:.7g}" for value in row]
            if k % POSE_STEPS:
                cells[1:10] = [""] * 9
            lines.append(",".join(cells))
        (folder / f"flight_{flight}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "mapping.yaml").write_text(MAPPING, encoding="utf-8")
    (folder / "vehicle.yaml").write_text(VEHICLE, encoding="utf-8")
    said = {"condition": hide, "truth": truth}
    (folder / "truth.json").write_text(json.dumps(said), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Fly rotorpy with something hidden.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--hide", choices=HIDDEN, help="in all flights; default: in turn")
    options = parser.parse_args()
    for number in range(options.cases):
        hidden = options.hide or list(HIDDEN)[number % len(HIDDEN)]
        case = options.folder / f"{number:03d}_{hidden}"
        write_case(case, hidden, [options.seed, number])
