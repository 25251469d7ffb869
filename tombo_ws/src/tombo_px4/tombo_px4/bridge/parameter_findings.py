"""Findings of the preflight checks, and those on PX4's parameters for flying on motion capture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum

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
    "COM_RCL_EXCEPT": 4,
    "NAV_DLL_ACT": 0,
}
"""What `px4_parameters=safe` sets; OFFBOARD needs neither remote control nor ground station."""
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
class Finding:
    """What is wrong, why, and the remedy."""

    key: str
    text: str
    weight: FindingSeverity = FindingSeverity.BLOCKS


_WARNING = FindingSeverity.WARNING


def parameter_findings(values: Values, system: int) -> Iterator[Finding]:
    """Yield what in the vehicle's parameters is not right for flight on poses.

    Args:
        values: as far as they are known.
        system: the one we speak to.
    """
    if EV_CTRL in values:
        yield from _fusion(int(values[EV_CTRL]), int(values.get(HGT_REF, _VISION_HEIGHT)))
    others = _competing_sensors(values)
    if others:
        text = f"EKF2 also uses {others}: indoors they pull the estimate off; set them to 0"
        yield Finding("other_sensors", text, _WARNING)
    delay = values.get(EV_DELAY, 0.0)
    if delay > _HIGHEST_DELAY_MS:
        text = (
            f"EKF2_EV_DELAY is {delay:.0f} ms, on top of stamps that already say when a pose was"
            " captured: set it to 0, or to what the stamps leave out"
        )
        yield Finding("ev_delay", text, _WARNING)
    if values.get("MAV_SYS_ID", system) != system:
        text = f"MAV_SYS_ID is {values['MAV_SYS_ID']}, not {system}: set link.system"
        yield Finding("system_id", text, _WARNING)
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
        yield Finding("loss_parameters", text)
    # links that PX4 requires before it arms
    if values.get("NAV_DLL_ACT", 0) > 0:
        text = (
            f"NAV_DLL_ACT is {values['NAV_DLL_ACT']} (as in Gazebo's airframes): PX4 arms only"
            " with a ground station connected; connect one, or set it to 0"
        )
        yield Finding("ground_station", text, FindingSeverity.ADVICE)
    if not int(values.get("COM_RCL_EXCEPT", _OFFBOARD_EXCEPTED)) & _OFFBOARD_EXCEPTED:
        text = (
            f"COM_RCL_EXCEPT is {values['COM_RCL_EXCEPT']}, without bit 2: PX4 leaves OFFBOARD"
            " when no remote control is heard; have one on, or set it to 4"
        )
        yield Finding("remote_control", text, FindingSeverity.ADVICE)


def _fusion(control: int, reference: int) -> Iterator[Finding]:
    """Yield findings on how EKF2 uses the poses: EKF2_EV_CTRL and EKF2_HGT_REF."""
    if control == 0:
        text = "nothing is fused: EKF2_EV_CTRL is 0; set it to 11 (position, height, yaw)"
        yield Finding("not_fused", text)
        return
    if not control & _POSITION:
        text = f"position is not fused: EKF2_EV_CTRL is {control}, without bit 0; set it to 11"
        yield Finding("not_fused", text)
    if not control & _HEIGHT:
        text = f"height is not fused: EKF2_EV_CTRL is {control}, without bit 1; set it to 11"
        yield Finding("height_not_fused", text, _WARNING)
    if not control & _YAW:
        text = (
            f"yaw is not fused: EKF2_EV_CTRL is {control}, without bit 3: PX4 takes its heading"
            " from the magnetometer, which is wrong indoors; set it to 11"
        )
        yield Finding("yaw_not_fused", text, _WARNING)
    if reference != _VISION_HEIGHT:
        sensor = {0: "the barometer", 1: "GPS", 2: "the range finder"}.get(reference, "?")
        text = f"height refers to {sensor}: EKF2_HGT_REF is {reference}; set it to 3 (vision)"
        yield Finding("height_reference", text, _WARNING)


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
