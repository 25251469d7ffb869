"""Fly a Crazyflie over one course here and with crazyflow: one table of speed and positions.

    python -m tombo_benchmarks.peers PYTHON

PYTHON is that of an environment with crazyflow: `python -m venv FOLDER`, then
`FOLDER/bin/pip install crazyflow==0.4.0 jax==0.10.1 jaxlib==0.10.1` (1.6 GB).

It starts in hover, flies three legs of a triangle and holds: thrust and torque with the square of
the rotors' speed, a lag of first order, drag linear in the velocity, gravity.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median
from tempfile import gettempdir
from typing import Any, Final

import numpy as np

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.speed.kernel_flight import fly_vehicles, new_flight
from tombo_bringup.cli.errors import exit_code_of
from tombo_control.planning.leg import Leg, leg_reference, store_leg, straight_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import ARM_X, GRAVITY
from tombo_flight.scenario import Scenario, load_scenario

CASES: Final = {"1": 12000, "64": 6000, "4096": 1000}
"""Number of vehicles → ticks of the course that they fly."""
CORNERS: Final = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.2), (1.0, 1.0, 1.0), (0.0, 0.0, 1.0))
"""Places that the course joins by straight legs, map [m]."""
_ROUNDS: Final = 5
"""Measurements of each case; the median counts."""
_TICKS: Final = CASES["1"]
"""Ticks of the whole course."""
_SET_POINT_TICKS: Final = 20
"""Ticks between two set points: every position loop runs at 50 Hz."""
_SPEED, _PAUSE_S, _SPREAD_M = 0.6, 0.2, 0.05
"""Speed of a leg [m/s], rest after it, and half width of the cube of starts; chosen."""
_DRAG: Final = 0.0075
"""N s/m in the disc plane, estimated, because: 0.28 1/s of mass, as small quadrotors show."""
_SETTINGS: Final = (
    *("vehicle.rotor_height=0.0", f"effects.linear_rotor_drag.d_xy={_DRAG}"),
    *("effects.linear_rotor_drag.d_z=0", "effects.ground_effect.strength=0"),
    *("effects.gusts.deviation=0", "effects.thrust_scatter.deviation=0"),
)
"""The physics that both simulators have."""
_BLOCK: Final = 16
"""Vehicles that are flown at a time: their memory fits the cache."""
_SCRIPT: Final = Path(__file__).parents[1] / "other_environments" / "crazyflow_course.py"


def course_legs() -> list[tuple[Leg, int, int]]:
    """Return the legs with the first tick of each and the tick after its last."""
    legs: list[tuple[Leg, int, int]] = []
    first = 0
    for start, goal in pairwise(CORNERS):
        leg = straight_leg(start, goal, _SPEED, first * TICK_S)
        steps = math.ceil((leg.end_s + _PAUSE_S) / TICK_S / _SET_POINT_TICKS)
        legs.append((leg, first, steps * _SET_POINT_TICKS))
        first = steps * _SET_POINT_TICKS
    leg, first, _ = legs[-1]
    return [*legs[:-1], (leg, first, _TICKS)]


def set_points() -> Array:
    """Return position, velocity and acceleration (K, 9) that are asked for, every 20 ms, map."""
    rows = []
    for leg, first, last in course_legs():
        for tick in range(first, last, _SET_POINT_TICKS):
            rows.append(np.concatenate(leg_reference(leg, tick * TICK_S)[:3]))
    return np.array(rows)


def starts(count: int) -> Array:
    """Return where N vehicles hover at first (N, 3), map [m]: the first on the course."""
    shifts = np.random.default_rng(0).uniform(-_SPREAD_M, _SPREAD_M, (count, 3))
    shifts[0] = 0.0
    return np.asarray(np.array(CORNERS[0]) + shifts)


def course_scenario() -> Scenario:
    """Return the vehicle with the physics that both simulators have, other effects at null."""
    return load_scenario("hover", _SETTINGS, vehicle="crazyflie_2_1")


def hover_speed(scenario: Scenario) -> float:
    """Return the speed of each rotor in hover [rad/s]."""
    return math.sqrt(scenario.vehicle.hover_thrust() / float(scenario.propeller.k_thrust))


def order(scenario: Scenario) -> dict[str, Any]:
    """Return what crazyflow's process reads: SI units, map ENU, body FLU, rotors as PX4 counts."""
    vehicle, propeller = scenario.vehicle, scenario.propeller
    return {
        "mass": vehicle.mass,
        "inertia": [vehicle.inertia_xx, vehicle.inertia_yy, vehicle.inertia_zz],
        "arm": float(abs(vehicle.arm_length * ARM_X[0])),
        "k_thrust": propeller.k_thrust,
        "k_torque": propeller.k_torque,
        "rotor_inertia": vehicle.rotor_inertia,
        "motor_time_constant": vehicle.motor_time_constant,
        "drag": [_DRAG, _DRAG, 0.0],
        "gravity": GRAVITY,
        "hover_speed": hover_speed(scenario),
        "step_s": TICK_S,
        "set_point_ticks": _SET_POINT_TICKS,
        "set_points": set_points().tolist(),
        "starts": starts(max(map(int, CASES))).tolist(),
        "cases": CASES,
        "rounds": _ROUNDS,
    }


def fly_course(count: int, ticks: int) -> tuple[float, Array]:
    """Fly vehicles along the course, with true states in place of estimates.

    Args:
        count: N vehicles, from `starts`.
        ticks: steps of 1 ms that each flies.

    Returns:
        Steps of all vehicles per second of processor time, and last positions (N, 3), map [m].
    """
    scenario = course_scenario()
    flight = new_flight(scenario, 0)
    flight.plant.rotor_speed = flight.plant.rotor_command = hover_speed(scenario)
    flight.autopilot.setpoint.position = starts(1)[0]
    flight.autopilot.mode_asked = Phase.APPROACH
    plants = np.repeat(flight.plant.as_array(), count)
    autopilots = np.repeat(flight.autopilot.as_array(), count)
    plants["state"]["position"] = autopilots["state"]["position"] = starts(count)

    began_s = time.process_time()
    for leg, start, last in course_legs():
        if start < ticks:
            store_leg(flight.autopilot.leg, leg)
            autopilots["leg"] = flight.autopilot["leg"]
            for first in range(0, count, _BLOCK):  # vehicles of a block stay in the cache
                fly_vehicles(
                    plants, autopilots, flight.maps, flight.theta, flight.zero_noise,
                    first, min(first + _BLOCK, count), start, min(last, ticks),
                )  # fmt: skip
    return count * ticks / (time.process_time() - began_s), plants["state"]["position"].copy()


def fly_crazyflow(python: Path, sent: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `crazyflow_course.py` answers: rates, end, versions.

    Raises:
        InputError: it fails.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        [python, _SCRIPT], input=json.dumps(sent), capture_output=True, text=True,
        env={**kept, "JAX_PLATFORMS": "cpu"}, cwd=gettempdir(), check=False,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"'{python}': {last}; accepted: a Python that has crazyflow")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def comparison(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> str:
    """Return the table: steps in a second of a core, and how far the course's end is missed.

    Both have `rates`, number of vehicles → a number a round, and `end`, map [m].
    """
    rows: list[Sequence[str]] = []
    for count, rates in ours["rates"].items():
        here, there = median(rates), median(theirs["rates"][count])
        speeds = (f"{1e-6 * here:.3g} M", f"{1e-6 * there:.3g} M")
        rows.append((f"steps of {count} vehicles", *speeds, f"{here / there:.3g}"))
    apart = [np.linalg.norm(np.array(one["end"]) - CORNERS[-1]) for one in (ours, theirs)]
    rows.append(("end of the course, from its goal", *(f"{1e3 * d:.1f} mm" for d in apart), ""))
    table = table_markdown(("a second of a core, steps of 1 ms", "here", "crazyflow", "×"), rows)
    return f"{table}\n{theirs['versions']}; medians of {len(rates)} rounds\n"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(prog="python -m tombo_benchmarks.peers")
    parser.add_argument("python", type=Path, help="of an environment with crazyflow")
    answer = fly_crazyflow(parser.parse_args().python.absolute(), order(course_scenario()))
    rates = {}
    for count, ticks in CASES.items():
        flown = [fly_course(int(count), ticks) for _ in range(_ROUNDS + 1)]  # the first compiles
        rates[count] = [rate for rate, _ in flown[1:]]
        if ticks == _TICKS:
            end = flown[-1][1][0]
    print(comparison({"rates": rates, "end": end}, answer))


if __name__ == "__main__":
    sys.exit(exit_code_of(main))
