"""Stands of the tests: their inputs and readings."""

import numpy as np

from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.propeller import configuration, parameter_row, speed_of_maximum_thrust
from tombo_dynamics.propeller.effects import Draws, Setup, predict

NOISE = (0.003, 0.005, 0.006, 0.0005)


def setup(confs=(5, 9, 13), runs=1, steps=14, loads=True, share=0.65) -> Setup:
    speed, prop, run, elapsed, rows, hung = [], [], [], [], [], []
    number = 0
    for k, conf in enumerate(confs):
        top = min(speed_of_maximum_thrust(configuration(conf))[0], 1100.0) * share
        for _ in range(runs):
            way = np.concatenate([np.zeros(3 * loads), np.linspace(0.25, 1.0, steps) * top])
            way = np.concatenate([way, way[::-1][1 : steps - 1]])
            n = way.size
            speed.append(way)
            prop.append(np.full(n, k))
            run.append(np.full(n, number))
            elapsed.append(np.linspace(0.0, 1.0, n))
            rows.append(np.tile(parameter_row(configuration(conf), "repaired"), (n, 1)))
            hung.append(np.append(np.array([0.0, 0.5, 1.0])[: 3 * loads], np.zeros(n - 3 * loads)))
            number += 1
    base = Setup(*(np.concatenate(x) for x in (speed, rows, prop, run, elapsed)))
    clean = predict(base, {})
    thrust, torque = float(np.nanmax(clean[:, 0])), float(np.nanmax(clean[:, 1]))
    load = np.concatenate(hung)
    return Setup(
        base.speed, base.rows, base.propeller, base.run, base.elapsed,
        applied_thrust=load * thrust, applied_torque=load * torque,
        largest_thrust=thrust, largest_torque=torque,
    )  # fmt: skip


def read(s: Setup, theta, channels=4, seed=0, draws=None, change=None) -> OperatingPoints:
    rng = np.random.default_rng(seed)
    drawn = draws or Draws.none(s)
    clean = predict(s, theta, drawn)
    if change is not None:
        clean = change(clean, s)
    size = np.array([s.largest_thrust, s.largest_torque, 1.0, float(s.speed.max())])
    sigma = np.tile(np.array(NOISE) * size, (clean.shape[0], 1))
    readings = clean + sigma * rng.standard_normal(clean.shape)
    readings[:, channels:] = np.nan
    readings[s.speed == 0.0, 2:] = np.nan
    props, runs = int(s.propeller.max()) + 1, int(s.run.max()) + 1
    return OperatingPoints(
        s, readings, sigma, tuple(f"run {k}" for k in range(runs)),
        tuple(f"propeller {k}" for k in range(props)),
    )  # fmt: skip
