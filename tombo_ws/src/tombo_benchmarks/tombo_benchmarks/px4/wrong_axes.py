"""Wrong set-ups of a motion capture, as functions of the true pose, and flights with each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.px4.lockstep_flight import AsMocap, fly_lockstep
from tombo_benchmarks.px4.lockstep_px4 import Px4Setup
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector
from tombo_dynamics.time_base import TICK_S
from tombo_flight.scenario import load_scenario
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.frames import px4_pose
from tombo_px4.hil.hand_motion import HandMotion

FARTHEST_M: Final = 0.5
"""No wrong set-up may take the vehicle further from where it took off, and:"""
HIGHEST_M: Final = 1.0
LONGEST_S: Final = 10.0
"""From the lift-off until it is disarmed."""
_LIFTED_M: Final = 0.02
"""Height above the first position from which on it has lifted off."""
_HAND_S: Final = 5.0
"""When the hand begins: PX4 has started, and its estimator has settled."""
_SWING_RAD: Final = 0.06
_SWING_RATIOS: Final = np.array([1.0, 0.7, 0.4])
"""Phase of another vehicle's swing from pose to pose [rad], times the ratio of x, y, z; chosen:
unequal, so that it does not swing along a line."""
_SWING_TURN: Final = 0.2
"""Vector part of its quaternion for a metre of the swing [1/m], chosen."""


def _turn(axis: int, degrees: float) -> Array:
    """Return the quaternion (4) xyzw of a turn about an axis, 0 to 2."""
    q = np.zeros(4)
    q[axis], q[3] = math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)
    return q


def _body(axis: int, degrees: float) -> AsMocap:
    """Return the poses of a rigid body that is turned against the vehicle."""
    turn = _turn(axis, degrees)
    return lambda place, q: (place, quaternion_multiply(q, turn))


_Y_UP: Final = _turn(0, -90.0)


def _y_up(place: Array, q: Array) -> tuple[Array, Array]:
    return rotate_vector(_Y_UP, place), quaternion_multiply(_Y_UP, q)


def _y_up_both(place: Array, q: Array) -> tuple[Array, Array]:
    place, q = _y_up(place, q)
    return place, quaternion_multiply(q, conjugate(_Y_UP))


@dataclass(frozen=True)
class WrongAxes:
    """A mistake in the axes, and a word that its message must have."""

    make: AsMocap
    word: str


WRONG_AXES: Final[Mapping[str, WrongAxes]] = {
    "body yawed by 90 deg": WrongAxes(_body(2, 90.0), "turned by 90 deg"),
    "body yawed by 180 deg": WrongAxes(_body(2, 180.0), "turned by 180 deg"),
    "body yawed by 45 deg": WrongAxes(_body(2, 45.0), "turned by 45 deg"),
    "y up in world and body": WrongAxes(_y_up_both, "not +z"),
    "y up in the world": WrongAxes(_y_up, "not +z"),
    "z down: NED and FRD": WrongAxes(px4_pose, "not +z"),
    "mirrored in y": WrongAxes(
        lambda place, q: (place * [1, -1, 1], q * [-1, 1, -1, 1]), "mirrored"
    ),
    "quaternion w first": WrongAxes(lambda place, q: (place, np.roll(q, 1)), "w first"),
    "body rolled by 90 deg": WrongAxes(_body(0, 90.0), "turned by 90 deg"),
    "x and y of positions exchanged": WrongAxes(
        lambda place, q: (place[[1, 0, 2]], q), "positions"
    ),
    "attitude inverse": WrongAxes(lambda place, q: (place, conjugate(q)), "inverse"),
}
"""Name -> poses that the motion capture sends."""


@dataclass
class _OtherBody:
    """Poses of a body that is not, or no longer, the vehicle.

    It stays at the first pose that is higher than `from_height_m`, or swings about it as another
    vehicle does. `noise`: standard deviation of each coordinate [m], and of the three components
    of the quaternion's vector part; 0: the pose is repeated to the bit.
    """

    from_height_m: float = -math.inf
    noise: float = 1e-3
    swing_m: float = 0.0
    _first_pose: tuple[Array, Array] | None = None
    _poses: int = 0

    def __call__(self, position: Array, attitude: Array) -> tuple[Array, Array]:
        """Return position (3) [m] and attitude (4) xyzw to send for the true ones, both in map."""
        self._poses += 1
        if self._first_pose is None:
            if position[2] < self.from_height_m:
                return position, attitude
            self._first_pose = position.copy(), attitude.copy()
        if self.noise == 0.0:
            return self._first_pose
        first_position, first_attitude = self._first_pose
        noise = self.noise * np.random.default_rng(self._poses).standard_normal(6)
        swing = self.swing_m * np.sin(_SWING_RAD * self._poses * _SWING_RATIOS)
        turn = np.append(noise[3:] + _SWING_TURN * swing, 1.0)
        turned = quaternion_multiply(first_attitude, turn / np.linalg.norm(turn))
        return first_position + noise[:3] + swing, turned


_LEVEL: Final = (
    *("body yawed by 90 deg", "body yawed by 180 deg", "body yawed by 45 deg"),
    *("mirrored in y", "x and y of positions exchanged"),
)
"""Those that a vehicle at rest does not show: with the proof of another body they are armed."""
_OLD: Final = ", old proof"
"""End of the names of flights that are armed with a proof that is not theirs."""


def wrong_axes_flights() -> Mapping[str, tuple[AsMocap | None, bool, str]]:
    """Return name -> what the motion capture sends, whether it is moved by hand, and a word.

    The first is a good set-up; the last ones are armed with a proof that is not theirs.
    """
    found: dict[str, tuple[AsMocap | None, bool, str]] = {"as it should be": (None, True, "")}
    found |= {name: (wrong.make, True, wrong.word) for name, wrong in WRONG_AXES.items()}
    found["good, but not proven"] = (None, False, "not proven")
    old: dict[str, tuple[AsMocap, str]] = {
        **{name: (WRONG_AXES[name].make, "") for name in _LEVEL},
        "body on the floor": (_OtherBody(), "does not move"),
        "frozen from the start": (_OtherBody(noise=0.0), "repeats"),
        "frozen in flight": (_OtherBody(0.6, noise=0.0), "repeats"),
        "stuck in flight, with noise": (_OtherBody(0.6), ""),
        "body of another vehicle": (_OtherBody(swing_m=0.1), "another body"),
        "positions x 1.5": (lambda place, q: (1.5 * place, q), "times as far"),
        "positions x 0.6": (lambda place, q: (0.6 * place, q), "times as far"),
        "millimetres": (lambda place, q: (1e3 * place, q), "millimetres"),
    }
    return found | {f"{name}{_OLD}": (make, False, word) for name, (make, word) in old.items()}


def fly_wrong_axes(setup: Px4Setup, name: str) -> dict[str, Any]:
    """Fly one of `wrong_axes_flights`; return its row of the table."""
    make, by_hand, word = wrong_axes_flights()[name]
    old = name.endswith(_OLD)
    summary, columns = fly_lockstep(
        setup,
        load_scenario("hover", []),
        bridge=BridgeParams(axes_evidence=SIMULATED if old else ""),
        as_mocap=make,
        hand=HandMotion(_HAND_S) if by_hand else None,
    )
    position = columns.get("position")
    away = height = aloft_s = 0.0
    if position is not None and len(position):
        away = float(np.linalg.norm(position[:, :2] - position[0, :2], axis=1).max())
        above = position[:, 2] - position[0, 2]
        height, disarmed_s = float(above.max()), summary["disarmed_s"]
        lifted_s = float(np.argmax(above > _LIFTED_M)) * TICK_S
        aloft_s = math.inf if disarmed_s is None else max(disarmed_s - lifted_s, 0.0)
    text = summary["why_not"] or "; ".join(text for _, text in summary.get("notes", ()))
    good = name == "as it should be"
    return {
        "set_up": name,
        "armed": summary["armed"],
        "away_m": away,
        "height_m": height,
        "aloft_s": aloft_s,
        "landed": bool(summary.get("landed")),
        "disarmed": summary.get("disarmed", True),
        "text": text,
        "as_wanted": bool(summary.get("landed"))
        if good
        else word in text and away <= FARTHEST_M and height <= HIGHEST_M and aloft_s <= LONGEST_S,
    }


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of the flights."""
    head = ("set-up", "armed", "away [m]", "height [m]", "aloft [s]", "at the end", "message")
    cells = []
    for row in rows:
        end = "on the ground, disarmed" if row["disarmed"] else "armed"
        end = "landed" if row["landed"] else end
        armed = "yes" if row["armed"] else "no"
        figures = (f"{row['away_m']:.2f}", f"{row['height_m']:.2f}", f"{row['aloft_s']:.1f}")
        cells.append([row["set_up"], armed, *figures, end, row["text"]])
    return table_markdown(head, cells)
