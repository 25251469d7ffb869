"""PX4's parameters: what a flight on poses asks of them, which the bridge reads and writes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.decoded_messages import ParameterValue
from tombo_px4.link.message_encoder import MessageTarget, float_of_int, read_parameter

EV_CTRL, EV_DELAY, SYS_HAS_GPS = "EKF2_EV_CTRL", "EKF2_EV_DELAY", "SYS_HAS_GPS"
DELAY_MAX, HOVER = "EKF2_DELAY_MAX", "MPC_THR_HOVER"
FUSED = 11
"""EKF2_EV_CTRL: position (1), height (2) and yaw (8)."""
_OFFBOARD_EXCEPTED = 4


class FindingSeverity(IntEnum):
    """Severity of a finding."""

    ADVICE = 0
    WARNING = 1
    BLOCKS = 2
    """The bridge does not arm while it exists."""


_ADVICE, _WARNING, _BLOCKS = FindingSeverity


@dataclass(frozen=True)
class FlightParameter:
    """A parameter on which a flight on poses depends."""

    name: str
    value: float
    """The value that is recommended."""
    accepts: Callable[[float], bool]
    why: str
    """What PX4 1.17 does with another value."""
    weight: FindingSeverity


FLIGHT_PARAMETERS = (
    FlightParameter(
        "COM_OBL_RC_ACT", 4, lambda action: action == 4,
        "set points or position lost: 4 lands; at 0, 1 and 2 it flies on in altitude and"
        " stabilized mode that nobody steers, at 3 it may climb to 60 m, at 6 and 7 it falls",
        _BLOCKS,
    ),
    FlightParameter(
        "COM_OF_LOSS_T", 1.0, lambda seconds: 0.25 <= seconds <= 2.0,
        "so long without set points it flies on; below 0.25 s one late set point ends a flight",
        _BLOCKS,
    ),
    FlightParameter(
        "EKF2_BARO_CTRL", 1, lambda used: used == 1,
        "the height while poses are lost; at 0 it does not notice the ground and stays armed",
        _BLOCKS,
    ),
    FlightParameter(
        "COM_DISARM_LAND", 2.0, lambda seconds: 0.1 <= seconds <= 10.0,
        "so long after landing it disarms; below 0 never", _BLOCKS,
    ),
    FlightParameter(
        EV_CTRL, FUSED, lambda bits: int(bits) & FUSED == FUSED,
        "without bit 0 it fuses no position, without bit 1 no height, without bit 3 no yaw: its"
        " heading is the magnetometer's, which is wrong indoors", _WARNING,
    ),
    FlightParameter(
        "EKF2_HGT_REF", 3, lambda sensor: sensor == 3,
        "height refers to another sensor than the poses: 0 the barometer, 1 GPS, 2 the range"
        " finder", _WARNING,
    ),
    FlightParameter(
        "EKF2_GPS_CTRL", 0, lambda used: used == 0, "GPS pulls the estimate off indoors", _WARNING
    ),
    FlightParameter(
        "EKF2_RNG_CTRL", 0, lambda used: used == 0,
        "the range finder pulls the estimate off", _WARNING,
    ),
    FlightParameter(
        "EKF2_MAG_TYPE", 5, lambda kind: kind == 5,
        "the magnetometer pulls the yaw off indoors", _WARNING,
    ),
    FlightParameter(
        EV_DELAY, 0.0, lambda ms: ms <= 30.0,
        "it counts on top of stamps that already say when a pose was captured", _WARNING,
    ),
    FlightParameter(
        "NAV_DLL_ACT", 0, lambda action: action <= 0,
        "as in Gazebo's airframes: it arms only with a ground station connected", _ADVICE,
    ),
    FlightParameter(
        "COM_RCL_EXCEPT", 4, lambda modes: bool(int(modes) & _OFFBOARD_EXCEPTED),
        "without bit 2 it leaves OFFBOARD when no remote control is heard; or have one on",
        _ADVICE,
    ),
)  # fmt: skip
"""With those that block, a real PX4 1.17 ends on the ground, disarmed, also without the bridge."""
SAFE_PARAMETERS: Mapping[str, float] = {
    **{p.name: p.value for p in FLIGHT_PARAMETERS if p.weight != _WARNING},
    "COM_LOW_BAT_ACT": 2,
}
"""What `px4_parameters=safe` sets; a critical battery lands, and OFFBOARD needs neither remote
control nor ground station."""
MOCAP_ONLY: Mapping[str, float] = {
    **{p.name: p.value for p in FLIGHT_PARAMETERS if p.weight == _WARNING and p.name != EV_DELAY},
    SYS_HAS_GPS: 0,
    "SYS_HAS_MAG": 0,
}
"""What `px4_parameters=mocap` sets. With these PX4 1.17 flew by external poses alone: position,
height and yaw."""
READ = (*(p.name for p in FLIGHT_PARAMETERS), SYS_HAS_GPS, DELAY_MAX, HOVER)
"""Parameters read from the vehicle."""


def explain_parameters(values: Mapping[str, float | int], weight: FindingSeverity) -> str:
    """Return in words which parameters of a severity are not accepted; "" if none is known."""
    no_gps = values.get(SYS_HAS_GPS, 1) == 0
    return "; ".join(
        f"{p.name} is {values[p.name]:g}, set it to {p.value:g} ({p.why})"
        for p in FLIGHT_PARAMETERS
        if p.weight == weight
        and not p.accepts(values.get(p.name, p.value))
        and not (no_gps and p.name == "EKF2_GPS_CTRL")
    )


SETS: Mapping[str, Mapping[str, float]] = {"safe": SAFE_PARAMETERS, "mocap": MOCAP_ONLY}
"""Word in `px4_parameters` → what it stands for: a loss ends on the ground; by poses alone."""
WRITES_ACCEPTED = f"{', '.join(SETS)}, or NAME=VALUE as EKF2_EV_CTRL=11"
_AGAIN_NS = SECOND_NS
_TRIES = 4
_AFRESH_NS = 15 * SECOND_NS
"""Period of reading all parameters again on the ground, where they may be changed."""
_AT_ONCE = 3
_INT32 = mav.MAV_PARAM_TYPE_INT32
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
    """Read `NAME=VALUE` of parameters to be written; a word of `SETS` stands for all of a set.

    Raises:
        InputError: names what is not of that form.
    """
    wanted: dict[str, float] = {}
    for text in texts:
        if text in SETS:
            wanted |= SETS[text]
            continue
        name, equals, value = text.partition("=")
        name = name.strip()
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not equals or not 0 < len(name) <= 16 or not math.isfinite(number):
            raise InputError(
                f"px4_parameters: '{text}' can't be used; accepted: {WRITES_ACCEPTED}"
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

    def take(self, parameter: ParameterValue) -> None:
        """Take a value, asked for or not: PX4 tells when one is changed."""
        if parameter.name not in self._names:
            return
        self.values[parameter.name] = parameter.value
        self._kinds[parameter.name] = parameter.kind
        wanted = self._writes.get(parameter.name)
        if wanted is not None and math.isclose(
            parameter.value, wanted, rel_tol=1e-5, abs_tol=1e-5
        ):
            if self._write_tries[parameter.name]:
                self._changed.add(parameter.name)
            del self._writes[parameter.name]

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
        if kind == _INT32:
            value = float_of_int(round(value))
        return mav.MAVLink_param_set_message(*self._to, name.encode(), value, kind)
