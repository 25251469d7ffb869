"""PX4's parameters: which the bridge reads and writes, and findings on their values."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.decoded_messages import ParameterValue
from tombo_px4.link.message_encoder import MessageTarget, float_of_int, read_parameter

EV_CTRL, EV_DELAY, HGT_REF = "EKF2_EV_CTRL", "EKF2_EV_DELAY", "EKF2_HGT_REF"
DELAY_MAX, HOVER = "EKF2_DELAY_MAX", "MPC_THR_HOVER"


@dataclass(frozen=True)
class LossParameter:
    """A parameter that decides how a flight ends when something is lost."""

    name: str
    value: float
    """The value that is recommended."""
    low: float
    high: float
    """The bridge arms with values from `low` to `high`."""
    why: str
    """What PX4 1.17 does with another value."""


LOSS_PARAMETERS = (
    LossParameter(
        "COM_OBL_RC_ACT", 4, 4, 4,
        "set points or position lost: 4 lands; at 0, 1 and 2 it flies on in altitude and"
        " stabilized mode that nobody steers, at 3 it may climb to 60 m, at 6 and 7 it falls",
    ),
    LossParameter(
        "COM_OF_LOSS_T", 1.0, 0.25, 2.0,
        "so long without set points it flies on; below 0.25 s one late set point ends a flight",
    ),
    LossParameter(
        "EKF2_BARO_CTRL", 1, 1, 1,
        "the height while poses are lost; at 0 it does not notice the ground and stays armed",
    ),
    LossParameter(
        "COM_DISARM_LAND", 2.0, 0.1, 10.0, "so long after landing it disarms; below 0 never"
    ),
)  # fmt: skip
"""With these a real PX4 1.17 ends on the ground, disarmed, also without the bridge."""
SAFE_PARAMETERS: Mapping[str, float] = {
    **{parameter.name: parameter.value for parameter in LOSS_PARAMETERS},
    "COM_LOW_BAT_ACT": 2,
    "COM_RCL_EXCEPT": 4,
    "NAV_DLL_ACT": 0,
}
"""What `px4_parameters=safe` sets; a critical battery lands, and OFFBOARD needs neither remote
control nor ground station."""
MOCAP_ONLY: Mapping[str, float] = {
    "SYS_HAS_GPS": 0,
    "SYS_HAS_MAG": 0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_RNG_CTRL": 0,
    "EKF2_MAG_TYPE": 5,
    "EKF2_EV_CTRL": 11,
    "EKF2_HGT_REF": 3,
}
"""What `px4_parameters=mocap` sets. With these PX4 1.17 flew by external poses alone: position,
height and yaw."""
READ = (
    EV_CTRL,
    EV_DELAY,
    HGT_REF,
    DELAY_MAX,
    HOVER,
    "EKF2_GPS_CTRL",
    "EKF2_RNG_CTRL",
    "EKF2_MAG_TYPE",
    "SYS_HAS_GPS",
    "MAV_SYS_ID",
    "COM_RCL_EXCEPT",
    "NAV_DLL_ACT",
    *(parameter.name for parameter in LOSS_PARAMETERS),
)
"""Parameters read from the vehicle."""
_POSITION, _HEIGHT, _YAW = 1, 2, 8
_VISION_HEIGHT = 3
_NO_MAG = 5
_HIGHEST_DELAY_MS = 30.0
_OFFBOARD_EXCEPTED = 4

Values = Mapping[str, float | int]


class FindingSeverity(IntEnum):
    """Severity of a finding."""

    ADVICE = 0
    WARNING = 1
    BLOCKS = 2
    """The bridge does not arm while it exists."""


@dataclass(frozen=True)
class PreflightFinding:
    """What is wrong, why, and the remedy."""

    key: str
    text: str
    weight: FindingSeverity = FindingSeverity.BLOCKS


_WARNING = FindingSeverity.WARNING


def parameter_findings(values: Values, system: int) -> Iterator[PreflightFinding]:
    """Yield what in the vehicle's parameters is not right for flight on poses.

    Args:
        values: as far as they are known.
        system: the one we speak to.
    """
    if EV_CTRL in values:
        yield from _fusion(int(values[EV_CTRL]), int(values.get(HGT_REF, _VISION_HEIGHT)))
    others = _competing_sensors(values)
    if others:
        text = (
            f"EKF2 also uses {others}: indoors they pull the estimate off; switch them off, as"
            " --bridge px4_parameters=mocap does"
        )
        yield PreflightFinding("other_sensors", text, _WARNING)
    delay = values.get(EV_DELAY, 0.0)
    if delay > _HIGHEST_DELAY_MS:
        text = (
            f"EKF2_EV_DELAY is {delay:.0f} ms, on top of stamps that already say when a pose was"
            " captured: set it to 0, or to what the stamps leave out"
        )
        yield PreflightFinding("ev_delay", text, _WARNING)
    if values.get("MAV_SYS_ID", system) != system:
        text = f"MAV_SYS_ID is {values['MAV_SYS_ID']}, not {system}: set link.system"
        yield PreflightFinding("system_id", text, _WARNING)
    wrong = [
        f"{p.name} is {values[p.name]:g}, set it to {p.value:g} ({p.why})"
        for p in LOSS_PARAMETERS
        if not p.low <= values.get(p.name, p.value) <= p.high
    ]
    if wrong:
        text = (
            f"a loss in flight would not end on the ground: {'; '.join(wrong)}. With your consent"
            " the bridge sets them: --bridge px4_parameters=safe"
        )
        yield PreflightFinding("loss_parameters", text)
    # links that PX4 requires before it arms
    if values.get("NAV_DLL_ACT", 0) > 0:
        text = (
            f"NAV_DLL_ACT is {values['NAV_DLL_ACT']} (as in Gazebo's airframes): PX4 arms only"
            " with a ground station connected; connect one, or set it to 0"
        )
        yield PreflightFinding("ground_station", text, FindingSeverity.ADVICE)
    if not int(values.get("COM_RCL_EXCEPT", _OFFBOARD_EXCEPTED)) & _OFFBOARD_EXCEPTED:
        text = (
            f"COM_RCL_EXCEPT is {values['COM_RCL_EXCEPT']}, without bit 2: PX4 leaves OFFBOARD"
            " when no remote control is heard; have one on, or set it to 4"
        )
        yield PreflightFinding("remote_control", text, FindingSeverity.ADVICE)


def _fusion(control: int, reference: int) -> Iterator[PreflightFinding]:
    """Yield findings on how EKF2 uses the poses: EKF2_EV_CTRL and EKF2_HGT_REF."""
    if control == 0:
        text = "nothing is fused: EKF2_EV_CTRL is 0; set it to 11 (position, height, yaw)"
        yield PreflightFinding("not_fused", text)
        return
    if not control & _POSITION:
        text = f"position is not fused: EKF2_EV_CTRL is {control}, without bit 0; set it to 11"
        yield PreflightFinding("not_fused", text)
    if not control & _HEIGHT:
        text = f"height is not fused: EKF2_EV_CTRL is {control}, without bit 1; set it to 11"
        yield PreflightFinding("height_not_fused", text, _WARNING)
    if not control & _YAW:
        text = (
            f"yaw is not fused: EKF2_EV_CTRL is {control}, without bit 3: PX4 takes its heading"
            " from the magnetometer, which is wrong indoors; set it to 11"
        )
        yield PreflightFinding("yaw_not_fused", text, _WARNING)
    if reference != _VISION_HEIGHT:
        sensor = {0: "the barometer", 1: "GPS", 2: "the range finder"}.get(reference, "?")
        text = f"height refers to {sensor}: EKF2_HGT_REF is {reference}; set it to 3 (vision)"
        yield PreflightFinding("height_reference", text, _WARNING)


def _competing_sensors(values: Values) -> str:
    """Return the other sensors that correct position, height and yaw, as words."""
    yaw_fused = int(values.get(EV_CTRL, 0)) & _YAW
    used = {
        "GPS (EKF2_GPS_CTRL)": values.get("EKF2_GPS_CTRL", 0) and values.get("SYS_HAS_GPS", 1),
        "range finder (EKF2_RNG_CTRL)": values.get("EKF2_RNG_CTRL", 0),
        "magnetometer (EKF2_MAG_TYPE, off: 5)": yaw_fused
        and values.get("EKF2_MAG_TYPE", _NO_MAG) != _NO_MAG,
    }
    return ", ".join(sensor for sensor, on in used.items() if on)


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
