"""Between command and rotor speed: lag, delay, supply voltage."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import DELAY_TICKS, Plant

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
def motor_lag(plant: Plant, noise: Array, extra_tau: float) -> None:
    """Add to the first-order time constant of rotor speed."""
    plant.motor_time_constant = max(1e-3, plant.motor_time_constant + extra_tau)


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
def command_delay(plant: Plant, noise: Array, delay: float) -> None:
    """Hand the drives the command of `delay` seconds ago (between ticks: interpolated)."""
    ticks = delay / plant.tick_length
    whole = int(ticks)
    fraction = ticks - whole
    newer = plant.past_commands[(plant.ticks - whole) % DELAY_TICKS]
    older = plant.past_commands[(plant.ticks - whole - 1) % DELAY_TICKS]
    for i in range(4):
        plant.rotor_target[i] = (1.0 - fraction) * newer[i] + fraction * older[i]


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
def battery_sag(plant: Plant, noise: Array, resistance: float, discharge: float) -> None:
    """Scale the reachable rotor speed by supply voltage over the full one.

    The current is mechanical power over voltage and a drive efficiency of 0.7.
    """
    power = 0.0
    for i in range(4):
        power += plant.rotor_torque[i] * plant.rotor_speed[i]
    current = power / (_DRIVE_EFFICIENCY * max(plant.supply.voltage, 3.0))
    plant.supply.charge += current * plant.tick_length / 3600.0
    plant.supply.current = current
    voltage = (
        plant.vehicle.battery_voltage - resistance * current - discharge * plant.supply.charge
    )
    plant.supply.voltage += (max(voltage, 3.0) - plant.supply.voltage) * (
        1.0 - math.exp(-plant.tick_length / 0.01)
    )
    for i in range(4):
        plant.rotor_target[i] *= plant.supply.voltage / plant.vehicle.battery_voltage
