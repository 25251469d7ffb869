"""Which mistake in axes explains a pose, found by gravity.

At rest the accelerometer points up. Turned by the pose's attitude it must point along +z of
`map`. If it does only after one of the usual mistakes is undone, that mistake is named. What a
motion by hand has proven is an `AxesEvidence`, kept in a YAML list that is never shortened.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector
from tombo_px4.bridge.bridge_params import SIMULATED

_HALF = math.sqrt(0.5)
_Y_UP = np.array([_HALF, 0.0, 0.0, _HALF])
"""Turns axes with y up into axes with z up: (x, y, z) -> (x, -z, y)."""
_UPSIDE_DOWN = -0.9


def up_error(attitude: Array, accel: Array) -> float:
    """Return the angle [rad] between +z and the accelerometer's direction in map.

    Args:
        attitude: (4) xyzw of the pose.
        accel: (3) specific force at rest, base_link.
    """
    up = rotate_vector(attitude, accel) / float(np.linalg.norm(accel))
    return math.acos(min(max(float(up[2]), -1.0), 1.0))


def explain_up(attitude: Array, accel: Array, limit: float) -> str:
    """Return which mistakes explain that the up axis is not +z; "" if it is.

    At rest several may: a motion by hand tells which (`hand_rotation_check`).
    """
    error = up_error(attitude, accel)
    if error <= limit:
        return ""
    degrees = math.degrees(error)
    world = quaternion_multiply(_Y_UP, attitude)
    both = quaternion_multiply(world, conjugate(_Y_UP))
    first = np.roll(attitude, -1)
    if math.cos(error) < _UPSIDE_DOWN:
        return (
            "mocap attitude hangs upside down: at rest gravity points along +z; it is one of a"
            " z-down body (NED, FRD), or the body was defined upside down: send ENU and FLU"
        )
    fits = []
    if up_error(first, accel) <= limit:
        fits.append("quaternion is w first: let the driver fill x, y, z, w")
    if min(up_error(both, accel), up_error(world, accel)) <= limit:
        fits.append(
            "pose is Y-up: set the streamed up axis to Z (OptiTrack Motive: Streaming, Up Axis)"
        )
    if not fits:
        return (
            f"mocap body is tilted by {degrees:.0f} deg against the autopilot: define the rigid"
            " body again with the vehicle level and its nose along +x"
        )
    fits.append("body lies on its side: define it again with the vehicle level")
    return (
        f"the vehicle would lie {degrees:.0f} deg off level: mocap "
        + "; or mocap ".join(fits)
        + "; turn and carry it by hand, which tells them apart"
    )


def up_in_pose_body(attitude: Array, accel: Array) -> tuple[float, float]:
    """Return x and y of the pose's +z against the accelerometer's up, base_link [rad].

    Args:
        attitude: (4) xyzw of the pose.
        accel: (3) specific force at rest, base_link.
    """
    up = accel / float(np.linalg.norm(accel))
    pose_up = rotate_vector(conjugate(attitude), np.array([0.0, 0.0, 1.0]))
    return float(pose_up[0] - up[0]), float(pose_up[1] - up[1])


@dataclass(frozen=True)
class AxesEvidence:
    """What a motion by hand has shown of the axes of a tracked body.

    Attributes:
        date: UTC, ISO 8601.
        body: name of the tracked body, as the bridge's parameter says.
        vehicle: hardware id of its autopilot.
        mistake: what is wrong with the axes; empty: they are right.
        turned_rad: about x, y and z of the vehicle.
        carried_m: along x, y and z of map.
        delay_ms: of the poses against the gyro.
        tilt_rad: of the body's z against gravity at rest, about the vehicle's y and x.
    """

    date: str
    body: str
    vehicle: str
    mistake: str = ""
    turned_rad: tuple[float, ...] = ()
    carried_m: tuple[float, ...] = ()
    delay_ms: float = 0.0
    tilt_rad: tuple[float, ...] = ()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}

    @classmethod
    def of_mapping(cls, values: Mapping[str, Any]) -> AxesEvidence:
        """Return the record of plain values.

        Raises:
            InputError: a key is unknown or missing, or a value is of another type.
        """
        known = {f.name for f in fields(cls)}
        wrong = sorted(set(values) - known)
        missing = sorted({"date", "body", "vehicle", "tilt_rad"} - set(values))
        if wrong or missing:
            raise InputError(
                f"proof of the axes: {', '.join([*wrong, *missing])} unknown or missing; accepted:"
                f" {', '.join(sorted(known))}"
            )
        made: dict[str, Any] = {
            key: tuple(map(float, value)) if isinstance(value, list) else value
            for key, value in values.items()
        }
        return cls(**made)


def valid_proof(proofs: Iterable[AxesEvidence], vehicle: str) -> AxesEvidence | None:
    """Return the last record of a vehicle, by its hardware id; None without one, or a mistake."""
    last = [e for e in proofs if vehicle and e.vehicle == vehicle][-1:]
    return last[0] if last and not last[0].mistake else None


_DEFAULT = Path("tombo/px4_axes.yaml")
_SYSTEM = "system"
"""Key of records before 0.2, which name the MAVLink system, the same for every vehicle."""


class AxesFile:
    """Reads and adds to the file; without one where the poses are simulated."""

    def __init__(self, axes_evidence: str) -> None:
        """Name the file by the bridge's parameter `axes_evidence`."""
        base = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        named = Path(axes_evidence).expanduser() if axes_evidence else base / _DEFAULT
        self._path = None if axes_evidence == SIMULATED else named

    def of_body(self, body: str) -> tuple[AxesEvidence, ...]:
        """Return all records of a named body, the oldest first; none for a body without a name.

        Raises:
            InputError: the file can't be read, or holds something else.
        """
        return tuple(e for e in self._records() if body and e.body == body)

    def add(self, evidence: AxesEvidence) -> str:
        """Add a record; return where, as the end of a sentence.

        Raises:
            InputError: the file can't be written.
        """
        if self._path is None:
            return ""
        if not (evidence.body and evidence.vehicle):
            return ", for this run alone: px4.tracked_body, or PX4's hardware id, has no name"
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(yaml.safe_dump([evidence.as_mapping()], sort_keys=False))
        except OSError as error:
            raise InputError(
                f"px4.axes_evidence '{self._path}': can't be written ({error.strerror}); accepted:"
                " a file that can"
            ) from None
        return f", kept in {self._path}"

    def _records(self) -> list[AxesEvidence]:
        if self._path is None or not self._path.is_file():
            return []
        try:
            entries = yaml.safe_load(self._path.read_text(encoding="utf-8")) or []
            return [AxesEvidence.of_mapping(v) for v in entries if _SYSTEM not in v]
        except (OSError, UnicodeDecodeError, yaml.YAMLError, InputError, TypeError, ValueError):
            raise InputError(
                f"px4.axes_evidence '{self._path}': no list of proofs of axes; accepted: the file"
                " that the bridge writes"
            ) from None
