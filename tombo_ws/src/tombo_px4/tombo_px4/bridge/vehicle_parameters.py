"""PX4's parameters: requirements of a flight on poses, which the bridge reads and writes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.messages import MessageTarget, ParameterValue, float_of_int, read_parameter

EV_CTRL, EV_DELAY = "EKF2_EV_CTRL", "EKF2_EV_DELAY"
_GPS_CTRL, _HAS_GPS = "EKF2_GPS_CTRL", "SYS_HAS_GPS"
HOVER = "MPC_THR_HOVER"
FUSED = 11
"""EKF2_EV_CTRL: position (1), height (2) and yaw (8)."""


class FlightParameter(NamedTuple):
    """A parameter on which a flight on poses depends.

    Attributes:
        name: PX4's.
        value: the one that is recommended.
        why: what PX4 1.17 does with another value.
        set_by: word in `px4_parameters` that sets it; "": it is only told.
        accepts: whether a value is good; None: it is not checked.
        blocks: the bridge does not arm with another value.
    """

    name: str
    value: float
    why: str
    set_by: str
    accepts: Callable[[float], bool] | None = None
    blocks: bool = False


_SAFE, _MOCAP = "safe", "mocap"
FLIGHT_PARAMETERS = (
    FlightParameter(
        "COM_OBL_RC_ACT", 4,
        "set points or position lost: 4 lands; at 0, 1 and 2 it flies on in altitude and"
        " stabilized mode that nobody steers, at 3 it may climb to 60 m, at 6 and 7 it falls",
        _SAFE, lambda action: action == 4, blocks=True,
    ),
    FlightParameter(
        "COM_OF_LOSS_T", 1.0,
        "so long without set points it flies on; below 0.25 s one late set point ends a flight",
        _SAFE, lambda seconds: 0.25 <= seconds <= 2.0, blocks=True,
    ),
    FlightParameter(
        "EKF2_BARO_CTRL", 1,
        "the height while poses are lost; at 0 it does not notice the ground and stays armed",
        _SAFE, lambda used: used == 1, blocks=True,
    ),
    FlightParameter(
        "COM_DISARM_LAND", 2.0, "so long after landing it disarms; below 0 never",
        _SAFE, lambda seconds: 0.1 <= seconds <= 10.0, blocks=True,
    ),
    FlightParameter(
        EV_CTRL, FUSED,
        "without bit 0 it fuses no position, without bit 1 no height, without bit 3 no yaw: its"
        " heading is the magnetometer's, which is wrong indoors",
        _MOCAP, lambda bits: int(bits) & FUSED == FUSED,
    ),
    FlightParameter(
        "EKF2_HGT_REF", 3,
        "height refers to another sensor than the poses: 0 the barometer, 1 GPS, 2 the range"
        " finder",
        _MOCAP, lambda sensor: sensor == 3,
    ),
    FlightParameter(
        _GPS_CTRL, 0, "GPS pulls the estimate off indoors", _MOCAP, lambda used: used == 0,
    ),
    FlightParameter(
        "EKF2_RNG_CTRL", 0, "the range finder pulls the estimate off",
        _MOCAP, lambda used: used == 0,
    ),
    FlightParameter(
        "EKF2_MAG_TYPE", 5, "the magnetometer pulls the yaw off indoors",
        _MOCAP, lambda kind: kind == 5,
    ),
    FlightParameter(
        EV_DELAY, 0.0, "it counts on top of stamps that already say when a pose was captured",
        "", lambda ms: ms <= 30.0,
    ),
    FlightParameter(
        "NAV_DLL_ACT", 0,
        "the bridge is its ground station: PX4 does this when the bridge ends in flight",
        _SAFE,
    ),
    FlightParameter(
        "COM_RCL_EXCEPT", 4,
        "without bit 2 it leaves OFFBOARD when no remote control is heard; or have one on",
        _SAFE,
    ),
    FlightParameter("COM_LOW_BAT_ACT", 2, "a critical battery: 2 lands", _SAFE),
    FlightParameter(_HAS_GPS, 0, "no GPS receiver is expected indoors", _MOCAP),
    FlightParameter("SYS_HAS_MAG", 0, "no magnetometer is expected indoors", _MOCAP),
)  # fmt: skip
"""With the blocking parameters, a real PX4 1.17 ends on the ground, disarmed, also without the
bridge."""
SAFE_PARAMETERS: Mapping[str, float] = {
    p.name: p.value for p in FLIGHT_PARAMETERS if p.set_by == _SAFE
}
"""What `px4_parameters=safe` sets; a critical battery lands, and OFFBOARD needs neither remote
control nor another ground station."""
MOCAP_ONLY: Mapping[str, float] = {
    p.name: p.value for p in FLIGHT_PARAMETERS if p.set_by == _MOCAP
}
"""What `px4_parameters=mocap` sets. With these PX4 1.17 flew by external poses alone: position,
height and yaw."""
SETS: Mapping[str, Mapping[str, float]] = {_SAFE: SAFE_PARAMETERS, _MOCAP: MOCAP_ONLY}
"""Word in `px4_parameters` → its parameters: a loss ends on the ground; by poses alone."""
READ = (*(p.name for p in FLIGHT_PARAMETERS if p.accepts), _HAS_GPS, HOVER)
"""Parameters read from the vehicle."""


def explain_parameters(values: Mapping[str, float | int], blocks: bool) -> str:
    """Return the parameters that are not accepted, in words: blocking ones, or the others."""
    no_gps = values.get(_HAS_GPS, 1) == 0
    return "; ".join(
        f"{p.name} is {values[p.name]:g}, set it to {p.value:g} ({p.why})"
        for p in FLIGHT_PARAMETERS
        if p.accepts is not None
        and p.blocks == blocks
        and not p.accepts(values.get(p.name, p.value))
        and not (no_gps and p.name == _GPS_CTRL)
    )


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
    """Read `NAME=VALUE` of parameters to be written; a word of `SETS` selects all of a set.

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
        self._to = to
        self._wanted = dict(writes or {})
        """To be written; what PX4 has taken is left out."""
        self._names = list(dict.fromkeys([*names, *self._wanted]))
        self.reset()

    def reset(self) -> None:
        """Forget all values: another vehicle, or a restart of it."""
        self._known: dict[str, ParameterValue] = {}
        self._reads = dict.fromkeys(self._names, _TRIES)
        """Name -> requests that are left, until it is answered."""
        self._writes = dict.fromkeys(self._wanted, _TRIES)
        self._asked_ns: Counter[str] = Counter()
        self._changed: set[str] = set()
        self._begun_ns: int | None = None

    @property
    def values(self) -> dict[str, float | int]:
        """Newest values from the vehicle."""
        return {name: known.value for name, known in self._known.items()}

    @property
    def unwritten(self) -> dict[str, float]:
        """Names that the vehicle did not accept."""
        refused = (n for n in self._wanted if self._silent(n) or not self._writes[n])
        return {name: self._wanted[name] for name in refused}

    @property
    def await_restart(self) -> list[str]:
        """Names of changed parameters that PX4 uses after its next start only."""
        return [name for name in _AT_START if name in self._changed]

    @property
    def complete(self) -> bool:
        """All requests are answered or given up."""
        return all(name in self._known or self._silent(name) for name in self._names)

    def _silent(self, name: str) -> bool:
        """Return whether the vehicle does not answer to a name."""
        return name not in self._known and not self._reads[name]

    def take(self, parameter: ParameterValue) -> None:
        """Take a value, asked for or not: PX4 tells when one is changed."""
        name = parameter.name
        if name not in self._names:
            return
        self._known[name], self._reads[name] = parameter, 0
        wanted = self._wanted.get(name, math.nan)
        if math.isclose(parameter.value, wanted, rel_tol=1e-5, abs_tol=1e-5):
            del self._wanted[name]
            if self._writes[name] < _TRIES:
                self._changed.add(name)

    def tick(self, now_ns: int, on_ground: bool) -> list[Any]:
        """Return what to send now."""
        self._begun_ns = now_ns if self._begun_ns is None else self._begun_ns
        if on_ground and self.complete and now_ns - self._begun_ns > _AFRESH_NS:
            self._reads, self._begun_ns = dict.fromkeys(self._names, 1), now_ns
        messages: list[Any] = []
        for name in self._names:
            if now_ns - self._asked_ns[name] <= _AGAIN_NS or len(messages) >= _AT_ONCE:
                continue
            known = self._known.get(name)
            if on_ground and known is not None and name in self._wanted:
                counts, message = self._writes, self._write(name, self._wanted[name], known.kind)
            else:
                counts, message = self._reads, read_parameter(self._to, name)
            if counts[name]:
                counts[name] -= 1
                self._asked_ns[name] = now_ns
                messages.append(message)
        return messages

    def _write(self, name: str, value: float, kind: int) -> Any:
        value = float_of_int(round(value)) if kind == _INT32 else value
        return mav.MAVLink_param_set_message(*self._to, name.encode(), value, kind)


def parameter_file() -> str:
    """Return what `safe` and `mocap` set as a file that QGroundControl loads, with the reasons.

    A row has vehicle, component, name, value and MAVLink's type, with tabs between them.
    """
    lines = [
        "# PX4 1.17, flights by motion capture. In QGroundControl: Vehicle Configuration,",
        "# Parameters, Tools, Load from file. Then restart PX4.",
        "# Vehicle-Id Component-Id Name Value Type",
    ]
    for name, value, why, *_ in sorted(
        (p for p in FLIGHT_PARAMETERS if p.set_by), key=lambda p: [*SETS].index(p.set_by)
    ):
        kind = _INT32 if isinstance(value, int) else mav.MAV_PARAM_TYPE_REAL32
        lines += [f"# {name}: {why}", f"1\t1\t{name}\t{value}\t{kind}"]
    return "\n".join(lines) + "\n"
