"""Flies the course of `tombo_benchmarks.peers` with crazyflow on JAX. Runs in its own environment.

    python crazyflow_course.py < ORDER.json > ANSWER.json

Rigid body of first principles under Runge-Kutta, its Mellinger controller with its own gains; one
compiled call a flight. It needs nothing of Tombo: the order is plain numbers.
"""

from __future__ import annotations

import json
import math
import sys
import time
from importlib.metadata import version
from typing import Any

import crazyflow.sim.functional as F
import jax
import jax.numpy as jnp
import numpy as np
from crazyflow.control import Control
from crazyflow.dynamics import Dynamics
from crazyflow.sim import Sim
from crazyflow.sim.integration import Integrator

Order = dict[str, Any]
_RPM = 60.0 / (2.0 * math.pi)
_DRONE = "cf2x_L250"


def simulation(order: Order, count: int) -> Sim:
    """Return `count` worlds with a vehicle each, in hover at the course's begin."""
    rate = round(1.0 / order["step_s"])
    sim = Sim(
        n_worlds=count, drone=_DRONE, dynamics=Dynamics.first_principles, control=Control.state,
        integrator=Integrator.rk4, freq=rate, state_freq=rate // order["set_point_ticks"],
        attitude_freq=rate, body_rate_freq=rate, force_torque_freq=rate,
    )  # fmt: skip
    old = sim.data.params
    thrust, torque = ([0.0, 0.0, order[k] / _RPM**2] for k in ("k_thrust", "k_torque"))
    lag = 1.0 / order["motor_time_constant"]
    inertia = np.diag(order["inertia"])
    new: dict[str, Any] = {
        "mass": [order["mass"]], "L": [order["arm"]], "prop_inertia": [order["rotor_inertia"]],
        "gravity_vec": [0.0, 0.0, -order["gravity"]], "J": inertia,
        "J_inv": np.linalg.inv(inertia), "rpm2thrust": [thrust], "rpm2torque": [torque],
        "drag_matrix": -np.diag(order["drag"]), "rotor_dyn_coef": [[lag, 0.0, lag, 0.0]],
    }  # fmt: skip
    params = old.replace(**{k: jnp.asarray(v, getattr(old, k).dtype) for k, v in new.items()})
    states = sim.data.states
    states = states.replace(
        pos=states.pos + jnp.asarray(order["set_points"][0][:3], states.pos.dtype),
        rotor_vel=jnp.full_like(states.rotor_vel, order["hover_speed"] * _RPM),
    )
    controls = known_vehicle(order, sim.data.controls, thrust)
    sim.data = sim.data.replace(params=params, states=states, controls=controls)
    return sim


def known_vehicle(order: Order, controls: Any, thrust: list[float]) -> Any:
    """Return the controllers with the vehicle that they fly; their gains stay."""
    mass_thrust = float(
        controls.state.params["pwm_max"] / (4.0 * controls.state.params["thrust_max"])
    )
    new = {
        "mass": order["mass"], "mass_thrust": mass_thrust, "L": order["arm"],
        "gravity_vec": [0.0, 0.0, -order["gravity"]],
        "thrust2torque": order["k_torque"] / order["k_thrust"], "rpm2thrust": thrust,
    }  # fmt: skip
    changed = {}
    for name in ("state", "attitude", "force_torque"):
        part = getattr(controls, name)
        params = {k: jnp.asarray(new.get(k, v), jnp.float32) for k, v in part.params.items()}
        changed[name] = part.replace(params=params)
    return controls.replace(**changed)


def fly(order: Order, count: int, ticks: int) -> tuple[list[float], list[float]]:
    """Return steps in a second of a processor core, a number a round, and where one ends [m]."""
    sim = simulation(order, count)
    places = jnp.asarray(np.array(order["starts"][:count])[:, None], sim.data.states.pos.dtype)
    data = sim.data.replace(states=sim.data.states.replace(pos=places))
    step, length = sim._step, order["set_point_ticks"]
    rows = np.zeros((ticks // length, sim.n_worlds, 1, 16), np.float32)
    rows[..., 12] = 1.0
    rows[..., :9] = np.array(order["set_points"])[: len(rows), None, None]

    def hold(data: Any, row: Any) -> tuple[Any, None]:
        return step(F.state_control(data, row), n_steps=length), None

    set_points = jnp.asarray(rows)
    compiled = jax.jit(lambda data, rows: jax.lax.scan(hold, data, rows)[0])
    compiled = compiled.lower(sim.data, set_points).compile()
    rates = []
    for _ in range(order["rounds"] + 1):  # the first one warms up
        began_s = time.process_time()
        flown = compiled(data, set_points)
        flown.states.pos.block_until_ready()
        rates.append(count * ticks / (time.process_time() - began_s))
    return rates[1:], np.asarray(flown.states.pos)[0, 0].tolist()


if __name__ == "__main__":
    asked: Order = json.load(sys.stdin)
    flown = {c: fly(asked, int(c), ticks) for c, ticks in asked["cases"].items()}
    answer = {
        "rates": {count: rates for count, (rates, _) in flown.items()},
        "end": flown["1"][1],
        "versions": ", ".join(f"{name} {version(name)}" for name in ("crazyflow", "jax")),
    }
    print(json.dumps(answer))
