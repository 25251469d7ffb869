"""What goes wrong in a simulated flight, when, and how much: for any simulator.

Only numpy is imported: another simulator's own environment imports this file, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
KINDS: Final = {
    "motor_stopped": "motor_or_propeller_lost",
    "propeller_lost": "motor_or_propeller_lost",
    "wall_struck": "contact",
    "ceiling_struck": "contact",
    "gains_too_high": "oscillation",
    "poses_frozen": "loss_of_position",
    "poses_jumped": "loss_of_position",
    "battery_empty": "battery",
    "command_wrong": "command",
    "killed": "kill",
}
"""Kind of mishap → cause that is right."""
BEFORE_S: Final = (3.0, 6.0)
"""Flight before the mishap."""
AFTER_S: Final = 2.5
_CONTACT_RATE, _CONTACT_DAMPING = 70.0, 0.25
"""rad/s and ratio of a vehicle that bounces."""


@dataclass(frozen=True)
class Mishap:
    """One kind of mishap at a time, its sizes drawn from a seed."""

    kind: str
    """Of KINDS; empty: the flight is healthy."""
    time: float
    """[s]"""
    rotor: int
    size: float
    """0 to 1, from mild to severe within the kind."""
    way: tuple[float, float]
    """Unit vector in the horizontal plane."""
    phase: tuple[float, float, float]
    """Of the course [rad]."""
    gap: bool
    """Poses that are lost are absent, not repeated."""

    @staticmethod
    def draw(kind: str, rng: np.random.Generator) -> Mishap:
        """Draw time and sizes."""
        angle = rng.uniform(0.0, 2.0 * np.pi)
        phase = rng.uniform(0.0, 2.0 * np.pi, 3)
        return Mishap(
            kind, float(rng.uniform(*BEFORE_S)), int(rng.integers(4)), float(rng.uniform()),
            (float(np.cos(angle)), float(np.sin(angle))),
            (float(phase[0]), float(phase[1]), float(phase[2])), bool(rng.uniform() < 0.5),
        )  # fmt: skip

    def goal(self, t: float) -> Array:
        """Return position, velocity and acceleration wanted (3, 3)."""
        amplitude = np.array([0.9, 0.8, 0.2])
        rate = np.array([0.9, 1.1, 0.7])
        angle = rate * t + np.array(self.phase)
        path = np.array([
            amplitude * np.sin(angle), amplitude * rate * np.cos(angle),
            -amplitude * rate**2 * np.sin(angle),
        ])  # fmt: skip
        path[0, 2] += 1.5
        if t < self.time:
            return path
        since = t - self.time
        push = np.array([*self.way, 0.0])
        if self.kind == "command_wrong":  # into the ground, here or far away
            path[0] += 3.0 * self.size * push if self.gap else 0.0
            path[0, 2] = -0.5 - self.size
            path[1:, 2] = 0.0
        if self.kind == "ceiling_struck":  # it climbs
            climb = 0.8 + 0.8 * self.size
            path[0, 2] += climb * since
            path[1, 2] += climb
        return path

    def observed(self, t: float, known: Array, held: Array) -> Array:
        """Return position and velocity (6,) as the controller has them; `held` at the mishap."""
        if t < self.time:
            return known
        if self.kind == "poses_frozen":
            return held
        if self.kind == "poses_jumped":
            jump = (0.8 + 1.2 * self.size) * np.array([*self.way, 0.0])
            return np.asarray(known + np.concatenate([jump, np.zeros(3)]))
        return known

    def gain(self, t: float) -> float:
        """Return the factor on the gains of the attitude."""
        bad = self.kind == "gains_too_high" and t >= self.time
        return 2.5 + 2.0 * self.size if bad else 1.0

    def delay(self, t: float) -> float:
        """Return how late the motors get their commands [s]."""
        return 0.04 if self.kind == "gains_too_high" and t >= self.time else 0.0

    def commanded(self, t: float, speeds: Array) -> Array:
        """Return the speeds (4,) that are commanded, and logged [rad/s]."""
        return 0.0 * speeds if self.kind == "killed" and t >= self.time else speeds

    def reached(self, t: float, speeds: Array) -> Array:
        """Return the speeds (4,) that the motors go for [rad/s]."""
        if t < self.time:
            return speeds
        if self.kind == "motor_stopped":
            slow = 0.3 * (1.0 - self.size) * speeds
            return np.asarray(np.where(np.arange(4) == self.rotor, slow, speeds))
        return np.asarray(speeds * np.sqrt(self.supply(t)))

    def supply(self, t: float) -> float:
        """Return voltage over that of a full battery: it falls off its knee."""
        slow = 1.0 - 0.004 * t
        if self.kind != "battery_empty" or t < self.time:
            return slow
        return slow * max(1.0 - (0.25 + 0.5 * self.size) * (t - self.time), 0.25)

    def thrust_gains(self, t: float) -> Array:
        """Return the factor on each rotor's thrust (4,)."""
        if self.kind != "propeller_lost" or t < self.time:
            return np.ones(4)
        return np.asarray(np.where(np.arange(4) == self.rotor, 0.35 * (1.0 - self.size), 1.0))


def began(mishap: Mishap, t: Array, rates: Array, command: Array, scene_began: float) -> float:
    """Return when a flight first deviated [s]; rates (N, 3) and commands (N, 4) are true ones.

    Loops begin to oscillate once rates or commands leave their earlier range. Others do at once.
    """
    if mishap.kind != "gains_too_high" or not scene_began < np.inf:
        return scene_began
    before = t < mishap.time
    sizes = [
        np.abs(values - np.median(values[before], axis=0)).max(axis=1)
        for values in (rates[:, :2], command - command.mean(axis=1, keepdims=True))
    ]
    settled = before & (t > 1.0)
    late = ~before & np.any([s > 1.5 * s[settled].max() for s in sizes], axis=0)
    return float(t[int(np.argmax(late))]) if late.any() else scene_began


class Scene:
    """Obstacles: the floor, and a wall or a ceiling that a mishap puts there.

    Attributes:
        began: when the mishap began [s]; NaN: not yet.
    """

    def __init__(self, mishap: Mishap) -> None:
        self.began = float("nan")
        self._mishap = mishap
        self._walls: list[tuple[Array, float]] = [(np.array([0.0, 0.0, -1.0]), 0.0)]

    def push(self, t: float, place: Array, speed: Array) -> tuple[Array, Array]:
        """Return the acceleration by what is touched [m/s^2] and where it acts, over the arm."""
        self._begin(t, place, speed)
        out: Array = np.zeros(3)
        where: Array = np.zeros(3)
        for normal, edge in self._walls:
            deep, pace = float(place @ normal) - edge, float(speed @ normal)
            if deep > 0.0:
                back = _CONTACT_RATE**2 * deep + 2.0 * _CONTACT_DAMPING * _CONTACT_RATE * pace
                out -= normal * max(back, 0.0) + 3.0 * (speed - normal * pace)  # and friction
                aside = np.array([-self._mishap.way[1], self._mishap.way[0], 0.0])
                where = (0.1 + 0.3 * self._mishap.size) * aside
        return out, where

    def _begin(self, t: float, place: Array, speed: Array) -> None:
        """Let the mishap begin when its time has come; a wall when the vehicle is fast enough."""
        if self.began == self.began or t < self._mishap.time:
            return
        if self._mishap.kind in ("wall_struck", "ceiling_struck"):
            normal: Array = np.array([0.0, 0.0, 1.0])
            if self._mishap.kind == "wall_struck":
                normal = np.array([speed[0], speed[1], 0.0]) / max(np.hypot(*speed[:2]), 1e-6)
            if speed @ normal < 0.4:
                return
            self._walls.append((normal, float(place @ normal)))
        self.began = t
