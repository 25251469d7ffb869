"""Reads parameters of the vehicle by name, and writes those the operator asks for."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.parameter_findings import SAFE_PARAMETERS
from tombo_px4.link.decoded_messages import ParameterValue
from tombo_px4.link.message_encoder import MessageTarget, read_parameter

SAFE = "safe"
"""Word for all parameters that let a loss end on the ground."""
_AGAIN_NS = SECOND_NS
_TRIES = 4
_AFRESH_NS = 15 * SECOND_NS
"""Period of reading all parameters again on the ground, where they may be changed."""
_AT_ONCE = 3
_WHOLE = mav.MAV_PARAM_TYPE_INT32
_AT_START = (
    "EKF2_HGT_REF",
    "EKF2_MAG_TYPE",
    "EKF2_EV_DELAY",
    "EKF2_DELAY_MAX",
    "SYS_HAS_GPS",
    "SYS_HAS_MAG",
    "SYS_HAS_BARO",
    "MAV_SYS_ID",
)
"""PX4 reads these when it starts."""


def parse_assignments(texts: Sequence[str]) -> dict[str, float]:
    """Read `NAME=VALUE` of parameters to be written; `safe` stands for `SAFE_PARAMETERS`.

    Raises:
        InputError: names what is not of that form.
    """
    wanted: dict[str, float] = {}
    for text in texts:
        if text == SAFE:
            wanted |= SAFE_PARAMETERS
            continue
        name, equals, value = text.partition("=")
        name = name.strip()
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not equals or not 0 < len(name) <= 16 or not math.isfinite(number):
            raise InputError(
                f"px4_parameters: '{text}' can't be used; accepted: {SAFE}, or NAME=VALUE as"
                " EKF2_EV_CTRL=11"
            )
        wanted[name] = number
    return wanted


class ParameterReader:
    """Asks for a few parameters at a time until each is known or has not answered four times."""

    def __init__(
        self, names: Iterable[str], to: MessageTarget, writes: Mapping[str, float] | None = None
    ) -> None:
        self.values: dict[str, float | int] = {}
        """Newest values from the vehicle."""
        self._changed: set[str] = set()
        self._names = list(dict.fromkeys([*names, *(writes or {})]))
        self._writes = dict(writes or {})
        self._kinds: dict[str, int] = {}
        self._to = to
        self._tries: Counter[str] = Counter()
        self._asked_ns: dict[str, int] = {}
        self._write_tries: Counter[str] = Counter()
        self._begun_ns: int | None = None

    @property
    def missing(self) -> list[str]:
        """Names the vehicle did not answer to."""
        return [n for n in self._names if n not in self.values and self._tries[n] >= _TRIES]

    @property
    def unwritten(self) -> dict[str, float]:
        """Names that the vehicle did not accept."""
        return {
            name: value
            for name, value in self._writes.items()
            if name in self.missing or self._write_tries[name] >= _TRIES
        }

    @property
    def await_restart(self) -> list[str]:
        """Names of changed parameters that PX4 uses after its next start only."""
        return [name for name in _AT_START if name in self._changed]

    @property
    def complete(self) -> bool:
        """Nothing is asked for any more."""
        return all(n in self.values or self._tries[n] >= _TRIES for n in self._names)

    def reset(self) -> None:
        """Forget all values: another vehicle, or a restart of it."""
        self.values.clear()
        self._tries.clear()
        self._asked_ns.clear()
        self._write_tries.clear()
        self._changed.clear()
        self._begun_ns = None

    def take(self, found: ParameterValue) -> None:
        """Take a value, asked for or not: PX4 tells when one is changed."""
        if found.name not in self._names:
            return
        self.values[found.name] = found.value
        self._kinds[found.name] = found.kind
        wanted = self._writes.get(found.name)
        if wanted is not None and math.isclose(found.value, wanted, rel_tol=1e-5, abs_tol=1e-5):
            if self._write_tries[found.name]:
                self._changed.add(found.name)
            del self._writes[found.name]

    def tick(self, now_ns: int, on_ground: bool) -> list[Any]:
        """Return what to send now."""
        if self._begun_ns is None or (
            on_ground and self.complete and now_ns - self._begun_ns > _AFRESH_NS
        ):
            again = self._begun_ns is not None
            self._begun_ns = now_ns
            self._tries = Counter(dict.fromkeys(self._names, _TRIES - 1) if again else {})
            self._asked_ns.clear()
        messages: list[Any] = []
        for name in self._names:
            asked_ns = self._asked_ns.get(name, 0)
            if now_ns - asked_ns <= _AGAIN_NS or len(messages) >= _AT_ONCE:
                continue
            writes = name in self._writes and name in self._kinds and on_ground
            fresh = name in self.values and asked_ns >= self._begun_ns
            tries = self._write_tries if writes else self._tries
            if tries[name] >= _TRIES or (fresh and not writes):
                continue
            tries[name] += 1
            self._asked_ns[name] = now_ns
            messages.append(self._write(name) if writes else read_parameter(self._to, name))
        return messages

    def _write(self, name: str) -> Any:
        value, kind = self._writes[name], self._kinds[name]
        if kind == _WHOLE:  # PX4 takes whole numbers by their bytes
            value = struct.unpack("<f", struct.pack("<i", round(value)))[0]
        return mav.MAVLink_param_set_message(*self._to, name.encode(), value, kind)
