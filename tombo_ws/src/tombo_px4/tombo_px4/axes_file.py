"""The file with the proofs of the poses' axes: a YAML list, the newest last, never shortened."""

from __future__ import annotations

import os
from pathlib import Path

import yaml

from tombo_dynamics.errors import InputError
from tombo_px4.bridge.bridge_params import SIMULATED
from tombo_px4.bridge.pose_axes import AxesEvidence

_DEFAULT = Path("tombo/px4_axes.yaml")


class AxesFile:
    """Reads and adds to the file; without one where the poses are simulated."""

    def __init__(self, axes_evidence: str) -> None:
        """Name the file by the bridge's parameter `axes_evidence`."""
        base = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        named = Path(axes_evidence).expanduser() if axes_evidence else base / _DEFAULT
        self._path = None if axes_evidence == SIMULATED else named

    def last(self, body: str, system: int) -> AxesEvidence | None:
        """Return the last record of a body and a vehicle; None: there is none, or it was refuted.

        Raises:
            InputError: the file can't be read, or holds something else.
        """
        fitting = [e for e in self._records() if (e.body, e.system) == (body, system)]
        return fitting[-1] if fitting and not fitting[-1].mistake else None

    def add(self, evidence: AxesEvidence) -> str:
        """Add a record; return where, as the end of a sentence.

        Raises:
            InputError: the file can't be written.
        """
        if self._path is None:
            return ""
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
            found = yaml.safe_load(self._path.read_text(encoding="utf-8")) or []
            return [AxesEvidence.of_mapping(values) for values in found]
        except (OSError, UnicodeDecodeError, yaml.YAMLError, InputError, TypeError, ValueError):
            raise InputError(
                f"px4.axes_evidence '{self._path}': no list of proofs of axes; accepted: the file"
                " that the bridge writes"
            ) from None
