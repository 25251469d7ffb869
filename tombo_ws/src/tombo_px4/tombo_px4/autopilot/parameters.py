"""The parameters of the autopilot: PX4's names, types and defaults, and what each does here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np


@dataclass(frozen=True)
class Px4Parameter:
    """One parameter. It is whole if its default is."""

    name: str
    default: float
    low: float
    high: float
    doc: str
    unit: str = ""

    @property
    def kind(self) -> Literal["int32", "float"]:
        """Type of the parameter in PX4."""
        return "int32" if isinstance(self.default, int) else "float"

    def rounded(self, value: float) -> float:
        """Return a value as the autopilot stores it."""
        if self.kind == "int32":
            return int(value)
        with np.errstate(over="ignore"):
            return float(np.float32(value))


_ROWS: tuple[tuple[Any, ...], ...] = (
    ("MAV_SYS_ID", 1, 1, 250, "system id on the link; taken at the start"),
    ("MAV_COMP_ID", 1, 1, 250, "component id on the link; taken at the start"),
    ("SYS_HAS_GPS", 1, 0, 1, "1: there is a GPS receiver"),
    ("SYS_HAS_MAG", 1, 0, 1, "1: there is a magnetometer, which gives the heading with GPS"),
    ("SYS_HAS_BARO", 1, 0, 1, "1: there is a barometer"),
    ("EKF2_GPS_CTRL", 7, 0, 15, "odd: GPS is fused, its heading by the magnetometer"),
    ("EKF2_BARO_CTRL", 1, 0, 1, "1: barometer's height, where vision gives none, is fused"),
    ("EKF2_RNG_CTRL", 1, 0, 2, "range finder; no effect here"),
    ("EKF2_MAG_TYPE", 0, 0, 6, "0 automatic, 5 none: no heading without vision"),
    ("EKF2_EV_CTRL", 0, 0, 15, "11: poses are fused: position, height and yaw together"),
    ("EKF2_HGT_REF", 1, 0, 3, "height of 0 barometer, 1 GPS, 3 vision; no effect here"),
    ("EKF2_EV_DELAY", 0.0, 0.0, 300.0, "age of a vision sample beyond its stamp", "ms"),
    ("EKF2_DELAY_MAX", 200.0, 0.0, 500.0, "older samples are dropped", "ms"),
    ("EKF2_NOAID_TOUT", 5_000_000, 500_000, 10_000_000, "longest time without a position", "us"),
    ("COM_RC_IN_MODE", 3, 0, 4, "remote control; no effect here"),
    ("RC_MAP_KILL_SW", 0, 0, 18, "channel of the kill switch of RC_CHANNELS_OVERRIDE; 0: none"),
    ("COM_KILL_DISARM", 5.0, 0.0, 30.0, "disarms so long after the kill switch", "s"),
    ("COM_MOT_TEST_EN", 1, 0, 1, "1: single motors may be turned while disarmed"),
    ("SYS_FAILURE_EN", 0, 0, 1, "1: MAV_CMD_INJECT_FAILURE may empty the battery"),
    ("COM_RCL_EXCEPT", 0, 0, 31, "modes that need no remote control; no effect here"),
    ("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "set points missing this long: offboard is lost", "s"),
    ("COM_OBL_RC_ACT", 0, 0, 7, "offboard lost: 3 return, 4 land, 5 hold, 6 and 7 rotors off"),
    ("COM_DISARM_LAND", 2.0, -1.0, 20.0, "disarms so long after landing; -1: never", "s"),
    ("COM_DISARM_PRFLT", 10.0, -1.0, 60.0, "disarms if not taken off; -1: never", "s"),
    ("COM_SPOOLUP_TIME", 1.0, 0.0, 5.0, "rotors idle so long after arming", "s"),
    ("COM_LOW_BAT_ACT", 0, 0, 3, "battery critical: 0 warn, 2 land, 3 return, then land"),
    ("NAV_DLL_ACT", 0, 0, 6, "ground station lost; no effect here"),
    ("GF_ACTION", 2, 0, 5, "outside the geofence: 2 hold, 5 land; no effect here"),
    ("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "radius of the geofence; 0: none; no effect here", "m"),
    ("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "its height; 0: none; no effect here", "m"),
    ("BAT_LOW_THR", 0.15, 0.12, 0.5, "charge that is low", "1"),
    ("BAT_CRIT_THR", 0.07, 0.05, 0.5, "charge that is critical", "1"),
    ("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "charge that is an emergency", "1"),
    ("BAT1_CAPACITY", 5000.0, -1.0, 100000.0, "charge of the full battery", "mAh"),
    ("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "height of a take-off above home", "m"),
    ("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "highest horizontal speed", "m/s"),
    ("MPC_XY_CRUISE", 5.0, 0.1, 20.0, "horizontal speed of AUTO modes", "m/s"),
    ("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "highest climb rate", "m/s"),
    ("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "highest sink rate", "m/s"),
    ("MPC_LAND_SPEED", 0.7, 0.2, 4.0, "sink rate of landing", "m/s"),
    ("MPC_TKO_SPEED", 1.5, 0.2, 5.0, "climb rate of take-off", "m/s"),
    ("MPC_TKO_RAMP_T", 3.0, 0.0, 5.0, "the climb rate is let rise so long", "s"),
    ("MPC_THR_HOVER", 0.5, 0.1, 0.8, "thrust that hovers: this vehicle's; no effect here", "1"),
)
PARAMETERS = tuple(Px4Parameter(*row) for row in _ROWS)
"""Those with "no effect here" are stored and reported alone."""

FLOWN_BY_POSES = {
    "SYS_HAS_GPS": 0,
    "SYS_HAS_MAG": 0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_RNG_CTRL": 0,
    "EKF2_MAG_TYPE": 5,
    "EKF2_EV_CTRL": 11,
    "EKF2_HGT_REF": 3,
    "COM_RCL_EXCEPT": 4,
    "COM_LOW_BAT_ACT": 2,
    "COM_OBL_RC_ACT": 4,
}
"""Settings of a lab, besides PX4's defaults, with which a real PX4 1.17 flew by poses alone."""


class ParameterTable:
    """Values of the parameters, in the order of the table. Floats have single precision.

    Attributes:
        stored: what clients have set, also out of bounds, as PX4 takes it.
    """

    def __init__(self) -> None:
        self._table = {p.name: p for p in PARAMETERS}
        self.stored = {p.name: p.rounded(p.default) for p in PARAMETERS}

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self._table)

    def get(self, name: str) -> float:
        """Return the value that acts: the one that is stored, within the bounds.

        Raises:
            KeyError: there is no such parameter.
        """
        value, parameter = self.stored[name], self._table[name]
        if math.isnan(value):
            return parameter.rounded(parameter.default)
        return min(max(value, parameter.rounded(parameter.low)), parameter.rounded(parameter.high))

    def store(self, name: str, value: float) -> None:
        """Store a value, also out of bounds, as PX4 does; KeyError: no such parameter."""
        self.stored[name] = self._table[name].rounded(value)

    def type_of(self, name: str) -> Literal["int32", "float"]:
        """Return `int32` or `float`; KeyError: there is no such parameter."""
        return self._table[name].kind

    def set_vehicle_default(self, name: str, value: float) -> None:
        """Set the default of this vehicle, unless a client has set another value."""
        parameter = self._table[name]
        if self.stored[name] == parameter.rounded(parameter.default):
            self.store(name, min(max(value, parameter.low), parameter.high))
