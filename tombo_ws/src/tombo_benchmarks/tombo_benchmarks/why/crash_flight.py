"""Crashes in the second simulator: its vehicles and controller, and what mishaps do to them."""

from __future__ import annotations

from math import isfinite

import numpy as np

from tombo_benchmarks.diagnosis.second_simulator.airframe import Airframe, Numbers
from tombo_benchmarks.diagnosis.second_simulator.controller import Tracker
from tombo_benchmarks.diagnosis.second_simulator.hidden import Hidden, draw_tolerances
from tombo_benchmarks.diagnosis.second_simulator.strangers import Stranger
from tombo_benchmarks.diagnosis.second_simulator.vehicles import Quadrotor
from tombo_benchmarks.why.mishap import AFTER_S, Array, Mishap, Scene

STEP_S = 0.004
_FASTEST = 80.0
"""rad/s, and m: beyond it the integration says nothing."""


class _CrashingAirframe(Airframe):
    """An airframe that touches things and loses propellers."""

    acceleration: Array = np.zeros(3)
    turning: Array = np.zeros(3)

    def slope(self, s: Numbers, target: Numbers, wind: Numbers, time: float) -> Numbers:
        """Return the state's derivative with what is touched; arguments as of an airframe."""
        out = super().slope(s, target, wind, time)
        for i in range(3):
            out[3 + i] += float(self.acceleration[i])
            out[10 + i] += float(self.turning[i])
        return out


def fly_crash(quad: Quadrotor, mishap: Mishap, rng: np.random.Generator) -> tuple[Array, float]:
    """Fly until some time after the mishap, or until nothing can be computed any more.

    Returns:
        Rows as `crash_log.write_crash` takes them, and when the mishap began [s].
    """
    frame = _CrashingAirframe(quad, Hidden(draw_tolerances(quad, rng)), Stranger())
    gains = list(frame.gain)
    pilot = Tracker(quad, STEP_S)
    k_r, k_w = pilot._k_r, pilot._k_w
    scene = Scene(mishap)
    state = frame.at_rest(mishap.goal(0.0)[0].tolist())
    state[3:6] = mishap.goal(0.0)[1].tolist()
    held = np.array(state[:6])
    rows = []
    commands = []
    for k in range(round((mishap.time + AFTER_S) / STEP_S)):
        t = k * STEP_S
        known = np.array(state[:6])
        held = known if t < mishap.time else held
        seen = mishap.seen(t, known, held)
        gain = mishap.gain(t)
        pilot._k_r = k_r[0] * gain, k_r[1] * gain, k_r[2]
        pilot._k_w = k_w[0] * gain, k_w[1] * gain, k_w[2]
        rates = [x + 0.01 * rng.standard_normal() for x in state[10:13]]
        goal = [*mishap.goal(t).ravel().tolist(), 0.0]
        asked = np.array(pilot.speeds([*seen.tolist(), *state[6:]], rates, goal))
        command = mishap.commanded(t, asked)
        commands.append(command)
        late = commands[max(k - round(mishap.delay(t) / STEP_S), 0)]
        frame.gain = [g * x for g, x in zip(gains, mishap.thrust_gains(t).tolist(), strict=True)]
        turn = _matrix(state[6:10])
        force, where = scene.push(t, known[:3], known[3:])
        frame.acceleration = force
        moment = np.cross(turn.T @ (quad.arm * where), turn.T @ force) * frame.mass
        frame.turning = moment / np.array(frame.inertia)
        new = frame.step(state, mishap.reached(t, late).tolist(), [0.0] * 3, t, STEP_S)
        felt = np.array(frame.felt[:3]) + turn.T @ force
        quaternion = [*state[7:10], state[6]]
        rows.append([
            t, *state[:3], *quaternion, *state[10:13], *felt, *state[13:17], *command,
            quad.battery * mishap.supply(t), *seen[:3],
        ])  # fmt: skip
        state = new
        if not all(map(isfinite, state)) or max(map(abs, state[:3] + state[10:13])) > _FASTEST:
            break
    return np.array(rows), scene.began


def _matrix(q: Numbers) -> Array:
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
