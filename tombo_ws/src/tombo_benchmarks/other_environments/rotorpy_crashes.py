"""Crashes rotorpy's Hummingbird. Runs in its own venv, with this package on PYTHONPATH.

    python rotorpy_crashes.py ORDERS.json

The orders: [{"path": of the .npz to write, "seed": [numbers], "kind": of `mishap.KINDS`}, ...].
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.vehicles.hummingbird_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from scipy.spatial.transform import Rotation

from tombo_benchmarks.why.mishap import AFTER_S, Array, Mishap, Scene

STEP_S = 0.005
_ARM, _VOLTS, _FASTEST = 0.17, 11.1, 80.0


class CrashingMultirotor(Multirotor):
    """A vehicle that touches things and loses propellers."""

    gains: Array = np.ones(4)
    force: Array = np.zeros(3)
    moment: Array = np.zeros(3)

    def compute_body_wrench(self, rates: Array, speeds: Array, air: Array) -> tuple[Array, Array]:
        """Return force and moment in body axes [N, N m]."""
        force, moment = super().compute_body_wrench(rates, speeds * np.sqrt(self.gains), air)
        return force + self.force, moment + self.moment


def fly(mishap: Mishap, rng: np.random.Generator) -> tuple[Array, float]:
    """Fly until some time after the mishap, or until nothing can be computed any more.

    Returns:
        Rows as `crash_log.write_crash` takes them, and when the mishap began [s].
    """
    true = dict(quad_params)
    for name in ("k_eta", "mass", "tau_m"):
        true[name] = true[name] * (1.0 + 0.03 * rng.standard_normal())
    begin = mishap.goal(0.0)
    hover = np.sqrt(true["mass"] * 9.81 / 4.0 / true["k_eta"])
    state: dict[str, Any] = {
        "x": begin[0], "v": begin[1], "q": np.array([0.0, 0.0, 0.0, 1.0]), "w": np.zeros(3),
        "wind": np.zeros(3), "rotor_speeds": np.full(4, hover),
    }  # fmt: skip
    vehicle, pilot, scene = CrashingMultirotor(true, state), SE3Control(quad_params), Scene(mishap)
    kp, kd = pilot.kp_att, pilot.kd_att
    held = np.concatenate([state["x"], state["v"]])
    rows = []
    commands = []
    for k in range(round((mishap.time + AFTER_S) / STEP_S)):
        t = k * STEP_S
        known = np.concatenate([state["x"], state["v"]])
        held = known if t < mishap.time else held
        seen = mishap.observed(t, known, held)
        gain = mishap.gain(t)
        pilot.kp_att, pilot.kd_att = kp * gain, kd * gain
        path = mishap.goal(t)
        goal = {
            "x": path[0], "x_dot": path[1], "x_ddot": path[2], "x_dddot": np.zeros(3),
            "x_ddddot": np.zeros(3), "yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0,
        }  # fmt: skip
        felt_rates = state["w"] + 0.01 * rng.standard_normal(3)
        believed = state | {"x": seen[:3], "v": seen[3:], "w": felt_rates}
        control = pilot.update(t, believed, goal)
        asked = np.clip(np.nan_to_num(control["cmd_motor_speeds"]), 0.0, true["rotor_speed_max"])
        command = mishap.commanded(t, asked)
        commands.append(command)
        late = commands[max(k - round(mishap.delay(t) / STEP_S), 0)]
        turn = Rotation.from_quat(state["q"])
        push, where = scene.push(t, known[:3], known[3:])
        vehicle.gains = mishap.thrust_gains(t)
        vehicle.force = turn.inv().apply(true["mass"] * push)
        vehicle.moment = np.cross(turn.inv().apply(_ARM * where), vehicle.force)
        control = control | {"cmd_motor_speeds": mishap.reached(t, late)}
        slope = vehicle.statedot(state, control, STEP_S)
        felt = turn.inv().apply(slope["vdot"] + [0.0, 0.0, 9.81])
        rows.append([
            t, *state["x"], *state["q"], *state["w"], *felt, *state["rotor_speeds"], *command,
            _VOLTS * mishap.supply(t), *seen[:3],
        ])  # fmt: skip
        state = vehicle.step(state, control, STEP_S)
        state["wind"] = np.zeros(3)
        size = np.abs(np.concatenate([state["x"], state["w"]])).max()
        if not size < _FASTEST:
            break
    return np.array(rows), scene.began


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        orders = json.load(file)
    for order in orders:
        chance = np.random.default_rng(order["seed"])
        rows, began = fly(Mishap.draw(order["kind"], chance), chance)
        np.savez_compressed(order["path"], rows=rows.astype(np.float32), began=began)
