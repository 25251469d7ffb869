"""Between command and rotor speed: lag, delay, supply voltage."""

from __future__ import annotations

import math

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import DELAY_TICKS, Array, P, V

_DRIVE_EFFICIENCY = 0.7


@effect(
    "motor_lag",
    Stage.BODY,
    [Param("extra_tau", "s", 0.0, (-0.03, 0.2), "time constant above the nominal one", 0.03)],
    signature="angular acceleration trails the command, more at high frequency, phase to -90 deg",
    separates_from={
        "command_delay": "fast rate steps: a delay moves the onset, a lag its slope",
        "inertia_error": "slow rate sweeps: a lag vanishes at low frequency, a factor stays",
    },
)
def motor_lag(m: Array, noise: Array, extra_tau: float) -> None:
    """Add to the first-order time constant of rotor speed."""
    m[P.inertial + 4] = max(1e-3, m[P.inertial + 4] + extra_tau)


@effect(
    "command_delay",
    Stage.COMMAND,
    [Param("delay", "s", 0.0, (0.0, 0.06), "from command to the drives", 0.015)],
    signature="angular acceleration trails the command by the same time at all frequencies",
    separates_from={
        "motor_lag": "fast rate steps: a delay moves the onset, a lag its slope",
        "mocap_stamp_error": "gyro against command: a wrong stamp leaves it alone",
    },
)
def command_delay(m: Array, noise: Array, delay: float) -> None:
    """Hand the drives the command of `delay` seconds ago (between ticks: interpolated)."""
    ticks = delay / m[P.clock + 1]
    whole = int(ticks)
    rest = ticks - whole
    newest = int(m[P.clock])
    a = (newest - whole) % DELAY_TICKS
    b = (newest - whole - 1) % DELAY_TICKS
    for i in range(4):
        m[P.target + i] = (1.0 - rest) * m[P.delay + 4 * a + i] + rest * m[P.delay + 4 * b + i]


@effect(
    "battery_sag",
    Stage.COMMAND,
    [
        Param("resistance", "ohm", 0.0, (0.0, 0.3), "internal resistance of pack and wires", 0.03),
        Param("discharge", "V/(A h)", 0.0, (0.0, 3.0), "voltage lost per charge used", 0.5),
    ],
    signature="thrust falls with current and along the flight, with the voltage",
    separates_from={"ground_effect": "two heights at equal voltage"},
)
def battery_sag(m: Array, noise: Array, resistance: float, discharge: float) -> None:
    """Scale the reachable rotor speed by supply voltage over the full one.

    The current is mechanical power over voltage and a drive efficiency of 0.7.
    """
    power = 0.0
    for i in range(4):
        power += m[P.torque + i] * m[P.speed + i]
    current = power / (_DRIVE_EFFICIENCY * max(m[P.supply + 2], 3.0))
    m[P.supply] += current * m[P.clock + 1] / 3600.0
    m[P.supply + 1] = current
    voltage = m[V.battery_voltage] - resistance * current - discharge * m[P.supply]
    m[P.supply + 2] += (max(voltage, 3.0) - m[P.supply + 2]) * (
        1.0 - math.exp(-m[P.clock + 1] / 0.01)
    )
    for i in range(4):
        m[P.target + i] *= m[P.supply + 2] / m[V.battery_voltage]
