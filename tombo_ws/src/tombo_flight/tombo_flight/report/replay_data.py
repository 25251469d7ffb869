"""Data of the 3-D replay: thinned columns, milestones, and the shapes of the vehicle."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PHASE_NAMES
from tombo_dynamics.vehicle import ARM_X, ARM_Y, VehicleParams
from tombo_flight.json_text import plain
from tombo_flight.report import style
from tombo_flight.report.milestones import ROTOR_NAMES, FlightMilestones

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


_DEFAULT = VehicleParams()


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
        """The airframe of a scenario as flown; missing values are the default vehicle's."""
        given = scenario.get("vehicle") or {}
        return cls(**{f.name: given[f.name] for f in fields(cls) if f.name in given})

    @property
    def rotors_m(self) -> Array:
        """(4, 3) rotor centres in base_link, in the rotor order."""
        height = np.full(4, self.rotor_height)
        return np.stack((self.arm_length * ARM_X, self.arm_length * ARM_Y, height), axis=1)


KEPT_HZ: Final = 100.0
MOST_SAMPLES: Final = 6000
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
    *("recovery_end_s", "crash_s", "verdict", "x_c_m", "x_r_m", "n_r", "fall_m"),
)


def kept_samples(t: Array) -> NDArray[np.intp]:
    """Return the indices of the kept samples of times (N,) [s], the first and the last among them.

    They are at 100 Hz, or as dense as `MOST_SAMPLES` allows.
    """
    count = min(math.ceil(float(t[-1] - t[0]) * KEPT_HZ), MOST_SAMPLES) + 1
    kept: NDArray[np.intp] = np.unique(np.linspace(0, t.size - 1, count).round().astype(np.intp))
    return kept


def flight_block(flight: Flight) -> dict[str, Any]:
    """Thinned columns, ready for JSON.

    `columns` is a list of [name, width]; `base64` is little-endian float32: for each column in
    turn its (samples, width) rows. `contact_N` is the largest contact force since the kept
    sample before, so that a contact of a few milliseconds is not lost.
    """
    index = kept_samples(flight.t)
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
    """Data of the scripts, without the columns, ready for JSON."""
    obstacle = milestones.obstacle
    return {
        **scene_block(flight.scenario),
        **{name: getattr(milestones, name) for name in _MILESTONES},
        "verdict": milestones.verdict.value,
        "obstacle": None if obstacle is None else vars(obstacle),
        "phases": [[s.start_s, s.end_s, s.phase] for s in milestones.phases],
        "rotor_names": ROTOR_NAMES,
        "events": [{k: event[k] for k in ("time_s", "kind", "text")} for event in flight.events],
    }


def scene_block(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Data of the scene that are the same in all flights of a scenario, ready for JSON."""
    airframe = DrawnAirframe.of(scenario)
    return {
        "phase_names": [name.replace("_", " ") for name in PHASE_NAMES],
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
    size = np.linalg.norm(force, axis=1)
    starts = np.concatenate(([0], index[:-1] + 1))
    largest: Array = np.maximum.reduceat(size[: index[-1] + 1], starts)
    return largest.reshape(-1, 1)
