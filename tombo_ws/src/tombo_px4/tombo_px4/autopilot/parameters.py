"""The parameters of the autopilot: PX4's names, types and defaults, and what each does here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["int32", "float"]


@dataclass(frozen=True)
class Px4Parameter:
    """One parameter."""

    name: str
    kind: Kind
    default: float
    low: float
    high: float
    unit: str
    doc: str
    acts: bool = True
    """False: the value is stored and reported, but has no effect in this simulation."""

    def rounded(self, value: float) -> float:
        """Return a value as the autopilot stores it."""
        if self.kind == "int32":
            return int(value)
        with np.errstate(over="ignore"):
            return float(np.float32(value))


def _int(
    name: str, default: int, low: int, high: int, doc: str, unit: str = "", acts: bool = True
) -> Px4Parameter:
    return Px4Parameter(name, "int32", default, low, high, unit, doc, acts)


def _float(
    name: str, default: float, low: float, high: float, unit: str, doc: str, acts: bool = True
) -> Px4Parameter:
    return Px4Parameter(name, "float", default, low, high, unit, doc, acts)


PARAMETERS: tuple[Px4Parameter, ...] = (
    # identity
    _int("MAV_SYS_ID", 1, 1, 250, "system id on the link; taken at the start"),
    _int("MAV_COMP_ID", 1, 1, 250, "component id on the link; taken at the start"),
    # sensors and estimator
    _int("SYS_HAS_GPS", 1, 0, 1, "1: there is a GPS receiver"),
    _int("SYS_HAS_MAG", 1, 0, 1, "1: there is a magnetometer, which gives the heading with GPS"),
    _int("SYS_HAS_BARO", 1, 0, 1, "1: there is a barometer"),
    _int("EKF2_GPS_CTRL", 7, 0, 15, "bits 0 position, 1 height, 2 velocity, 3 heading of GPS"),
    _int("EKF2_BARO_CTRL", 1, 0, 1, "1: barometer's height, where vision gives none, is fused"),
    _int("EKF2_RNG_CTRL", 1, 0, 2, "range finder; there is none", acts=False),
    _int("EKF2_MAG_TYPE", 0, 0, 6, "0 automatic, 5 none: no heading without vision"),
    _int("EKF2_EV_CTRL", 0, 0, 15, "bits 0 x and y, 1 height, 2 velocity, 3 yaw of vision"),
    _int("EKF2_HGT_REF", 1, 0, 3, "height from 0 barometer, 1 GPS, 2 range finder, 3 vision"),
    _float("EKF2_EV_DELAY", 0.0, 0.0, 300.0, "ms", "age of a vision sample beyond its stamp"),
    _float("EKF2_DELAY_MAX", 200.0, 0.0, 500.0, "ms", "older samples are dropped"),
    _float("EKF2_EVP_NOISE", 0.1, 0.01, 10.0, "m", "noise of vision's position, for the gate"),
    _float("EKF2_EVA_NOISE", 0.1, 0.05, 1.0, "rad", "noise of vision's yaw, for the gate"),
    _float("EKF2_EVP_GATE", 5.0, 1.0, 50.0, "SD", "vision beyond so many deviations is refused"),
    _float("EKF2_GPS_DELAY", 110.0, 0.0, 300.0, "ms", "age of a GPS fix when it arrives"),
    _float("EKF2_GPS_P_NOISE", 0.5, 0.01, 10.0, "m", "noise that a GPS fix is taken to have"),
    _int(
        "EKF2_NOAID_TOUT",
        5_000_000,
        500_000,
        10_000_000,
        "time without aiding after which the position is not valid",
        "us",
    ),
    # commander
    _int("COM_RC_IN_MODE", 3, 0, 4, "remote control; there is none", acts=False),
    _int("COM_RCL_EXCEPT", 0, 0, 31, "modes that need no remote control", acts=False),
    _float("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "s", "set points missing this long: offboard is lost"),
    _int(
        "COM_OBL_RC_ACT",
        0,
        0,
        7,
        "offboard lost: 0 position, 1 altitude, 2 stabilized (without a remote control "
        "NAV_RCL_ACT, but altitude or stabilized where the position is lost too), 3 return, "
        "4 land, 5 hold, 6 terminate, 7 disarm",
    ),
    _float("COM_DISARM_LAND", 2.0, -1.0, 20.0, "s", "disarms so long after landing; -1: never"),
    _float("COM_DISARM_PRFLT", 10.0, -1.0, 60.0, "s", "disarms if not taken off; -1: never"),
    _float("COM_SPOOLUP_TIME", 1.0, 0.0, 5.0, "s", "rotors idle so long after arming"),
    _float("COM_LKDOWN_TKO", 3.0, -1.0, 5.0, "s", "tilt beyond FD_FAIL_* so soon after: disarm"),
    _int("COM_LOW_BAT_ACT", 0, 0, 3, "battery critical: 0 warn, 2 land, 3 return, then land"),
    _int("CBRK_FLIGHTTERM", 121212, 0, 121212, "121212: tilt beyond FD_FAIL_* only warns"),
    _int("FD_FAIL_R", 60, 0, 180, "roll that is a failure; 0: none is", "deg"),
    _int("FD_FAIL_P", 60, 0, 180, "pitch that is a failure; 0: none is", "deg"),
    _float("FD_FAIL_R_TTRI", 0.3, 0.02, 5.0, "s", "roll for so long is a failure"),
    _float("FD_FAIL_P_TTRI", 0.3, 0.02, 5.0, "s", "pitch for so long is a failure"),
    _int("NAV_RCL_ACT", 2, 1, 6, "remote control lost: 1 hold, 2 return, 3 land, 5, 6 off"),
    _int("NAV_DLL_ACT", 0, 0, 6, "ground station lost; nothing is done", acts=False),
    # battery
    _float("BAT_LOW_THR", 0.15, 0.12, 0.5, "1", "charge that is low"),
    _float("BAT_CRIT_THR", 0.07, 0.05, 0.5, "1", "charge that is critical"),
    _float("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "1", "charge that is an emergency"),
    _float("BAT1_CAPACITY", 5000.0, -1.0, 100000.0, "mAh", "charge of the full battery"),
    # navigator
    _float("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "m", "height of a take-off above home"),
    _float("RTL_RETURN_ALT", 60.0, 0.0, 150.0, "m", "height of the way home"),
    _float("NAV_ACC_RAD", 10.0, 0.05, 200.0, "m", "so close a point is reached"),
    # multicopter
    _float("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "m/s", "highest horizontal speed"),
    _float("MPC_XY_CRUISE", 5.0, 0.1, 20.0, "m/s", "horizontal speed of AUTO modes"),
    _float("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "m/s", "highest climb rate"),
    _float("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "m/s", "highest sink rate"),
    _float("MPC_Z_V_AUTO_UP", 3.0, 0.2, 8.0, "m/s", "climb rate of AUTO modes"),
    _float("MPC_LAND_SPEED", 0.7, 0.2, 4.0, "m/s", "sink rate of landing"),
    _float("MPC_TKO_SPEED", 1.5, 0.2, 5.0, "m/s", "climb rate of take-off"),
    _float("MPC_TKO_RAMP_T", 3.0, 0.0, 5.0, "s", "the climb rate is let rise so long"),
    _float("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "deg", "highest tilt of position control"),
    _float(
        "MPC_THR_HOVER",
        0.5,
        0.1,
        0.8,
        "1",
        "thrust that hovers; set to this vehicle's own",
        acts=False,
    ),
    _float("MPC_XY_P", 0.95, 0.0, 2.0, "1/s", "velocity asked for per position error, height too"),
    _float("MPC_YAWRAUTO_MAX", 60.0, 5.0, 360.0, "deg/s", "yaw rate of position control"),
    _float("LNDMC_Z_VEL_MAX", 0.25, 0.0, 2.0, "m/s", "landed: vertical speed below this"),
    _float("LNDMC_XY_VEL_MAX", 1.5, 0.0, 3.0, "m/s", "landed: horizontal speed below this"),
)


class ParameterTable:
    """Values of the parameters, in the order of the table. Floats have single precision."""

    def __init__(self) -> None:
        self._table = {p.name: p for p in PARAMETERS}
        self._values = {p.name: p.rounded(p.default) for p in PARAMETERS}
        self._set_by_user: set[str] = set()
        self.version = 0
        """Grows with every change."""

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self._table)

    def get(self, name: str) -> float:
        """Return the value that acts: the one that is stored, within the bounds.

        Raises:
            KeyError: there is no such parameter.
        """
        value, parameter = self._values[name], self._table[name]
        if math.isnan(value):
            return parameter.rounded(parameter.default)
        return min(max(value, parameter.rounded(parameter.low)), parameter.rounded(parameter.high))

    def stored(self, name: str) -> float:
        """Return a value as a client has set it, which may be out of bounds.

        Raises:
            KeyError: there is no such parameter.
        """
        return self._values[name]

    def store(self, name: str, value: float) -> None:
        """Store what a client sends: PX4 takes what is out of bounds, too.

        Raises:
            KeyError: there is no such parameter.
        """
        self._set_by_user.add(name)
        self._change(name, self._table[name].rounded(value))

    def type_of(self, name: str) -> Kind:
        """Return `int32` or `float`.

        Raises:
            KeyError: there is no such parameter.
        """
        return self._table[name].kind

    def set(self, name: str, value: float) -> str:
        """Change a value; return "" or why it is refused."""
        parameter = self._table.get(name)
        if parameter is None:
            return f"unknown parameter {name}"
        if not math.isfinite(value):
            return f"{name}: {value} is no number"
        if parameter.kind == "int32" and value != int(value):
            return f"{name}: {value:g} is not a whole number"
        rounded = parameter.rounded(value)
        if not parameter.rounded(parameter.low) <= rounded <= parameter.rounded(parameter.high):
            return f"{name}: {value:g} is out of bounds {parameter.low:g} to {parameter.high:g}"
        self._set_by_user.add(name)
        self._change(name, rounded)
        return ""

    def set_vehicle_default(self, name: str, value: float) -> None:
        """Set the default of this vehicle, unless a client has set another value."""
        if name not in self._set_by_user:
            parameter = self._table[name]
            self._change(name, parameter.rounded(min(max(value, parameter.low), parameter.high)))

    def _change(self, name: str, value: float) -> None:
        if value != self._values[name]:
            self._values[name] = value
            self.version += 1
