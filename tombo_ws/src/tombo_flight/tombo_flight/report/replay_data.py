"""What the 3-D replay shows: thinned columns, milestones, and the shapes of the vehicle."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import rotation_matrix
from tombo_dynamics.vehicle import ARM_X, ARM_Y, VehicleParams
from tombo_flight.json_text import plain
from tombo_flight.report import style
from tombo_flight.report.milestones import PHASE_NAMES, ROTOR_NAMES, FlightMilestones, number

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


_DEFAULT = VehicleParams()


@dataclass(frozen=True)
class VehiclePart:
    """A piece of the vehicle: a filled outline, or a line with a thickness; map frame, metres."""

    kind: str
    points_m: Array
    thickness_m: float = 0.0
    rotor: int | None = None


@dataclass(frozen=True)
class DrawnAirframe:
    """The lengths [m] that a picture of the vehicle needs, by their names in `VehicleParams`."""

    arm_length: float = _DEFAULT.arm_length
    rotor_height: float = _DEFAULT.rotor_height
    rotor_radius: float = _DEFAULT.rotor_radius
    nodus_radius: float = _DEFAULT.nodus_radius
    leg_height: float = _DEFAULT.leg_height

    @classmethod
    def of(cls, scenario: Mapping[str, Any]) -> DrawnAirframe:
        """The airframe of a scenario as flown; what it does not say is the default vehicle's."""
        given = scenario.get("vehicle")
        lengths = {f.name: number(given, f.name) for f in fields(cls)} if given else {}
        return cls(**{name: length for name, length in lengths.items() if length is not None})

    @property
    def rotors_m(self) -> Array:
        """(4, 3) rotor centres in base_link, in the rotor order."""
        height = np.full(4, self.rotor_height)
        return np.stack((self.arm_length * ARM_X, self.arm_length * ARM_Y, height), axis=1)

    def disc(self, fold: float) -> Array:
        """Rim of a swept disc about its rotor axis, in base_link.

        The tip draws in to the radius at which the simulation has it, linear in the fold; a
        stiff wing hinged at the nodus then stands out of the rotor plane. It is drawn downwards.
        """
        wing = self.rotor_radius - self.nodus_radius
        stretched = 1.0 - min(max(fold, 0.0), 1.0)
        sink = wing * float(np.sqrt(1.0 - stretched**2))
        return circle(self.nodus_radius + wing * stretched, -sink)

    def parts(self, position: Array, attitude: Array, fold: Array) -> list[VehiclePart]:
        """Pieces of the vehicle at a pose.

        Args:
            position: (3,) centre of mass, map ENU, metres.
            attitude: (4,) quaternion xyzw, map<-base_link.
            fold: (4,) fold of each rotor, 0 stretched to 1 folded.
        """
        turn = matrix(attitude)

        def put(points: Sequence[Sequence[float]] | Array) -> Array:
            placed: Array = position + np.asarray(points, dtype=np.float64) @ turn.T
            return placed

        low = -self.leg_height
        parts = []
        for y in (-0.11, 0.11):
            parts.append(VehiclePart("leg", put(((0.0, y / 2, 0.0), (0.0, y, low))), 0.010))
            parts.append(VehiclePart("leg", put(((-0.12, y, low), (0.13, y, low))), 0.012))
        for rotor, hub in enumerate(self.rotors_m):
            x, y, z = hub
            parts.append(
                VehiclePart("arm", put(((0.2 * x, 0.2 * y, 0.0), (x, y, 0.0))), 0.020, rotor)
            )
            parts.append(
                VehiclePart("motor", put(((x, y, -0.004), (x, y, z - 0.006))), 0.028, rotor)
            )
            if fold[rotor] > 0.02:
                parts.append(VehiclePart("ghost", put(hub + self.disc(0.0)), 0.002, rotor))
            parts.append(
                VehiclePart("disc", put(hub + self.disc(float(fold[rotor]))), 0.006, rotor)
            )
        bottom, top = circle(0.07, -0.02, 9), circle(0.07, 0.022, 9)
        for k in range(8):
            parts.append(VehiclePart("side", put((bottom[k], bottom[k + 1], top[k + 1], top[k]))))
        parts.append(VehiclePart("deck", put(top)))
        parts.append(VehiclePart("nose", put(((0.02, 0.0, 0.024), (0.06, 0.0, 0.024))), 0.014))
        return parts


def circle(radius_m: float, height_m: float = 0.0, points: int = 49) -> Array:
    """(points, 3) closed outline of a horizontal circle about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack(
        (radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(points, height_m)), axis=1
    )


def matrix(attitude: Array) -> Array:
    """(4,) quaternion xyzw to the (3, 3) matrix that turns base_link into map."""
    turn = np.zeros((3, 3))
    rotation_matrix(np.asarray(attitude, dtype=np.float64), turn)
    return turn


@dataclass(frozen=True)
class Camera:
    """A pinhole camera at `eye` that looks at `target`, z up; metres, map ENU."""

    eye: Array
    target: Array

    @property
    def axes(self) -> Array:
        """Rows right, up, forward of the camera, in the map frame."""
        forward = (self.target - self.eye) / np.linalg.norm(self.target - self.eye)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.stack((right, np.cross(right, forward), forward))

    def project(self, points: Array) -> Array:
        """(..., 3) map points to (..., 3): picture x right, picture y up, depth [m]."""
        seen = (points - self.eye) @ self.axes.T
        flat = seen[..., :2] / np.maximum(seen[..., 2:], 1e-3)
        return np.concatenate((flat, seen[..., 2:]), axis=-1)


COARSE_HZ: Final = 50.0
FINE_HZ: Final = 200.0
FINE_BEFORE_S: Final = 0.5
FINE_AFTER_S: Final = 6.5
MOST_COARSE_SAMPLES: Final = 6000
"""A long flight is thinned further, so that the file stays small."""

COLUMNS: Final = (
    "position",
    "velocity",
    "attitude",
    "rates",
    "position_setpoint",
    "est_position",
    "rotor_thrust",
    "rotor_speed",
    "fold",
    "damage",
    "mode",
)
"""Columns of the log that are carried as they are, at the kept samples."""
_MILESTONES: Final = (
    *("duration_s", "mark_s", "contact_s", "detection_s", "switch_s", "unstable_end_s"),
    *("recovery_end_s", "crash_s", "verdict", "x_c_m", "x_r_m", "n_r", "contact_height_m"),
    *("lowest_m", "lowest_s"),
)


def kept_samples(t: Array, mark_s: float | None) -> NDArray[np.intp]:
    """Indices of the kept samples, ascending: 50 Hz, and 200 Hz around the contact.

    Args:
        t: (N,) times of the flight, seconds, ascending.
        mark_s: instant around which to keep more, or None.
    """
    if not len(t):
        return np.zeros(0, dtype=np.intp)
    end_s = float(t[-1])
    step_s = max(1.0 / COARSE_HZ, end_s / MOST_COARSE_SAMPLES)
    wanted = [np.arange(0.0, end_s, step_s), np.array([end_s])]
    if mark_s is not None:
        start_s = max(0.0, mark_s - FINE_BEFORE_S)
        stop_s = min(end_s, mark_s + FINE_AFTER_S)
        wanted += [np.arange(start_s, stop_s, 1.0 / FINE_HZ), np.array([mark_s])]
    half_tick_s = (t[1] - t[0]) / 2.0 if len(t) > 1 else 0.0
    index = np.searchsorted(t, np.concatenate(wanted) - half_tick_s)
    kept: NDArray[np.intp] = np.unique(np.clip(index, 0, len(t) - 1))
    return kept


def flight_block(flight: Flight, milestones: FlightMilestones) -> dict[str, Any]:
    """Thinned columns, ready for JSON.

    `columns` is a list of [name, width]; `base64` is little-endian float32: for each column in
    turn its (samples, width) rows. `contact_N` is the largest contact force since the kept
    sample before, so that a contact of a few milliseconds is not lost.
    """
    index = kept_samples(flight.t, milestones.mark_s)
    blocks: list[tuple[str, Array]] = [("t", flight.t[index].reshape(-1, 1))]
    blocks += [(name, flight.log[name].reshape(len(flight.t), -1)[index]) for name in COLUMNS]
    blocks.append(("contact_N", _largest_since(flight.log["contact_force"], index)))
    raw = b"".join(np.ascontiguousarray(b, dtype="<f4").tobytes() for _, b in blocks)
    return {
        "samples": len(index),
        "columns": [[name, block.shape[1]] for name, block in blocks],
        "base64": base64.b64encode(raw).decode("ascii"),
    }


def milestones_block(flight: Flight, milestones: FlightMilestones) -> dict[str, Any]:
    """Data of the scripts beside the columns, ready for JSON."""
    obstacle = milestones.obstacle
    return {
        **scene_block(flight.scenario),
        **{name: getattr(milestones, name) for name in _MILESTONES},
        "verdict": milestones.verdict.value,
        "obstacle": None if obstacle is None else vars(obstacle),
        "phases": [[s.start_s, s.end_s, s.phase] for s in milestones.phases],
        "rotor_names": ROTOR_NAMES,
        "events": [
            {
                "time_s": event.get("time_s"),
                "kind": str(event.get("kind", "")),
                "text": str(event.get("text", "")),
            }
            for event in flight.events
        ],
    }


def scene_block(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Data of the scene that are the same in all flights of a scenario, ready for JSON."""
    airframe = DrawnAirframe.of(scenario)
    return {
        "phase_names": PHASE_NAMES,
        "phase_colours": [
            style.PHASE_COLOURS.get(i, style.FAINT) for i in range(len(PHASE_NAMES))
        ],
        "shape": {
            "rotors_m": airframe.rotors_m,
            "disc_m": airframe.rotor_radius,
            "nodus_m": airframe.nodus_radius,
            "leg_m": airframe.leg_height,
        },
    }


def script_json(value: Any) -> str:
    """JSON that is safe inside a script element: no '<', '>' or '&', non-finite as null."""
    text = json.dumps(plain(value), separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _largest_since(force: Array, index: NDArray[np.intp]) -> Array:
    if not len(index):
        return np.zeros((0, 1))
    size = np.linalg.norm(force, axis=1)
    starts = np.concatenate(([0], index[:-1] + 1))
    largest: Array = np.maximum.reduceat(size[: index[-1] + 1], starts)
    return largest.reshape(-1, 1)
