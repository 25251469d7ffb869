"""The vehicles that are flown, by the numbers that their documentation prints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]

GRAVITY = 9.80665
"""m/s^2"""
ROTORS = ("rear_right", "front_right", "rear_left", "front_left")
"""Order of the motors, as on flight controllers of racing quadrotors."""
PLACES = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]) / np.sqrt(2.0)
"""(4, 2) Directions from the centre to the motors: forward, left."""
SPINS = np.array([-1.0, 1.0, 1.0, -1.0])
"""+1: counter-clockwise seen from above."""
_GRID = 4000


@dataclass(frozen=True)
class Quadrotor:
    """A vehicle as its documentation describes it."""

    name: str
    mass: float
    """kg"""
    inertia: tuple[float, float, float]
    """kg m^2, about x forward, y left, z up"""
    arm: float
    """m, centre to rotor axis"""
    rotor_height: float
    """m, discs above the centre of mass"""
    rotor_radius: float
    """m"""
    rotor_inertia: float
    """kg m^2, propeller and bell about the axis"""
    lag: float
    """s, first-order time constant of rotor speed"""
    speeds: tuple[float, float]
    """rad/s, least and largest"""
    thrust_table: tuple[tuple[float, float, float], ...]
    """rad/s, N, N m: thrust and torque of one rotor."""
    battery: float
    """V, full"""
    drag: tuple[float, float]
    """N s/m, linear drag in the disc plane and along the rotor axis"""
    ground: float = 1.0
    """Strength of the ground effect, 1: Cheeseman and Bennett's"""
    air_motion: float = 0.0
    """m/s, standard deviation of the air's motion indoors"""
    own_model: bool = False
    """Whether the suite has a model of it: then drag, ground and air are part of what is known."""

    @cached_property
    def table(self) -> Array:
        """(N, 3) speeds on a fine grid with thrust and torque, interpolated over the square."""
        given = np.array(self.thrust_table)
        square = given[:, 0] ** 2
        grid = np.linspace(0.0, 1.1 * self.speeds[1], _GRID)
        ratios = [
            PchipInterpolator(square[1:], given[1:, k] / square[1:], extrapolate=True)
            for k in (1, 2)
        ]
        inside = np.clip(grid**2, square[1], square[-1])
        return np.column_stack([grid, *(grid**2 * r(inside) for r in ratios)])

    @cached_property
    def _columns(self) -> tuple[list[float], list[float]]:
        return self.table[:, 1].tolist(), self.table[:, 2].tolist()

    @cached_property
    def _inverse(self) -> list[float]:
        """Speeds over a grid of even steps in the root of thrust."""
        roots = np.linspace(0.0, np.sqrt(self.table[-1, 1]), _GRID)
        speeds = np.interp(roots, np.sqrt(self.table[:, 1]), self.table[:, 0])
        return [float(x) for x in speeds]

    @cached_property
    def hover_speed(self) -> float:
        """Return the speed of a rotor in hover [rad/s]."""
        return self.speed_for(self.mass * GRAVITY / 4.0)

    def thrust_and_torque(self, speed: float) -> tuple[float, float]:
        """Return thrust [N] and drag torque [N m] of a rotor at a speed [rad/s]."""
        place = max(speed, 0.0) * (_GRID - 1) / (1.1 * self.speeds[1])
        k = min(int(place), _GRID - 2)
        part = place - k
        thrust, torque = self._columns
        return (
            thrust[k] + part * (thrust[k + 1] - thrust[k]),
            torque[k] + part * (torque[k + 1] - torque[k]),
        )

    def speed_for(self, thrust: float) -> float:
        """Return the speed [rad/s] for a thrust [N], within what the drives can do."""
        place = sqrt(max(thrust, 0.0) / float(self.table[-1, 1])) * (_GRID - 1)
        k = min(int(place), _GRID - 2)
        low, high = self._inverse[k], self._inverse[k + 1]
        return max(min(low + (place - k) * (high - low), self.speeds[1]), self.speeds[0])

    def throttle(self, speeds: Array) -> Array:
        """Return commands from 0 to 1 that ask for these speeds [rad/s].

        They are linear in thrust, if that grows with the square of the speed.
        """
        low, high = self.speeds
        return np.asarray((speeds**2 - low**2) / (high**2 - low**2))


_RPM = np.pi / 30.0
_CONF_13 = (
    (250.0, 0.010030163708808245, 0.0004295734709242721),
    (500.0, 0.04003384949574709, 0.0017116177204258788),
    (1000.0, 0.1587073876175404, 0.006742589664255614),
    (1500.0, 0.35179636051693985, 0.014814650114519988),
    (2000.0, 0.6133119915784879, 0.025580007013183727),
    (2500.0, 0.9371641635106351, 0.038728424217842686),
    (3000.0, 1.3179564340867074, 0.054021094928233634),
    (3500.0, 1.7507996648522155, 0.07127070240858255),
    (4000.0, 2.230795742604706, 0.09031294402353178),
    (4500.0, 2.7525994800503266, 0.11098922402666316),
    (5000.0, 3.3101479532132165, 0.13314112218108823),
    (5500.0, 3.896517906262791, 0.15661216864278443),
    (6000.0, 4.503855317224421, 0.18125316469651462),
    (6500.0, 5.123336637096136, 0.20692888483749478),
    (7000.0, 5.745136991368062, 0.2335251440817128),
    (7500.0, 6.3583903035291724, 0.2609558736670188),
    (8000.0, 6.9511308569658095, 0.2891702119611852),
)
"""rpm, N, N m: what `tombo propeller --conf 13 --json` prints."""

S500 = Quadrotor(
    "s500", 1.3, (0.0135, 0.0135, 0.024), 0.24, 0.03, 0.1111, 6e-5, 0.035, (100.0, 820.0),
    ((0.0, 0.0, 0.0), *((rpm * _RPM, thrust, torque) for rpm, thrust, torque in _CONF_13)),
    12.6, (0.3, 0.1), ground=1.0, air_motion=0.1, own_model=True,
)  # fmt: skip
"""The suite's own vehicle: docs/model.md and the scenario `no_obstacle`."""


def _square_law(
    k_thrust: float, k_torque: float, highest: float
) -> tuple[tuple[float, float, float], ...]:
    return tuple(
        (float(n), k_thrust * float(n) ** 2, k_torque * float(n) ** 2)
        for n in np.linspace(0.0, highest, 12)
    )


CRAZYFLIE = Quadrotor(
    "crazyflie", 0.027, (1.66e-5, 1.66e-5, 2.93e-5), 0.046, 0.005, 0.0231, 2e-8, 0.05,
    (100.0, 2900.0), _square_law(1.6e-8, 9.5e-11, 2900.0), 4.2, (0.0107, 0.003),
)  # fmt: skip
"""27 g; inertia and torque over thrust: J. Förster, ETH Zürich, 2015; thrust 0.066 N a rotor in
hover at 2030 rad/s."""

X500 = Quadrotor(
    "x500", 2.0, (0.0217, 0.0217, 0.04), 0.246, 0.05, 0.127, 9e-5, 0.02,
    (120.0, 1000.0), _square_law(8.55e-6, 1.37e-7, 1000.0), 16.8, (0.45, 0.15),
)  # fmt: skip
"""2 kg on 10-inch propellers; mass, inertia and constants of PX4's simulated X500."""

VEHICLES = {v.name: v for v in (S500, CRAZYFLIE, X500)}
