"""The axes of the tracked body: gravity at rest, and the kept proof of a motion by hand.

At rest the accelerometer points up. Turned by the pose's attitude it must point along +z of
`map`. What a motion by hand has proven is an `AxesEvidence`, kept in a YAML list that is never
shortened.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import conjugate, rotate_vector
from tombo_px4.bridge.bridge_params import SIMULATED


def up_error(attitude: Array, accel: Array) -> float:
    """Return the angle [rad] between +z and the accelerometer's direction in map.

    Args:
        attitude: (4) xyzw of the pose.
        accel: (3) specific force at rest, base_link.
    """
    up = rotate_vector(attitude, accel) / float(np.linalg.norm(accel))
    return math.acos(min(max(float(up[2]), -1.0), 1.0))


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
        tilt_rad: of the body's z against gravity at rest, about the vehicle's y and x.
    """

    date: str
    body: str
    vehicle: str
    mistake: str = ""
    tilt_rad: tuple[float, ...] = ()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self) | {"tilt_rad": list(self.tilt_rad)}

    @classmethod
    def of_mapping(cls, values: Mapping[str, Any]) -> AxesEvidence:
        """Return the record of plain values; others that are kept beside them count for nothing.

        Raises:
            KeyError: a value is missing.
            ValueError: it proves axes without a tilt.
        """
        tilt, mistake = tuple(map(float, values["tilt_rad"])), values.get("mistake", "")
        if not mistake and len(tilt) != 2:
            raise ValueError("tilt_rad")
        return cls(values["date"], values["body"], values["vehicle"], mistake, tilt)


def valid_proof(proofs: Iterable[AxesEvidence], vehicle: str) -> AxesEvidence | None:
    """Return the last record of a vehicle, by its hardware id; None without one, or a mistake."""
    last = [e for e in proofs if vehicle and e.vehicle == vehicle][-1:]
    return last[0] if last and not last[0].mistake else None


_DEFAULT = Path("tombo/px4_axes.yaml")


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
            return [AxesEvidence.of_mapping(v) for v in entries]
        except (OSError, ValueError, yaml.YAMLError, TypeError, AttributeError, KeyError):
            raise InputError(
                f"px4.axes_evidence '{self._path}': no list of proofs of axes; accepted: the file"
                " that the bridge writes"
            ) from None
