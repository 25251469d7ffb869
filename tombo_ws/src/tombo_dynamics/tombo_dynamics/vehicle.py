"""The airframe and its parameters: by default an S500-class quadrotor, each value with source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.params import param

GRAVITY = 9.80665
AIR_DENSITY = 1.2041
"""kg/m^3: dry air at 20 degC and 1013.25 hPa."""
ROTOR_NAMES = ("front_right", "rear_left", "front_left", "rear_right")
"""Rotor order everywhere: PX4's quad-x numbering 1..4."""
SPIN = np.array([1.0, 1.0, -1.0, -1.0])
"""+1: turns counter-clockwise seen from above (its angular momentum is along body +z)."""
ARM_X = np.array([1.0, -1.0, 1.0, -1.0]) / np.sqrt(2.0)
ARM_Y = np.array([-1.0, 1.0, 1.0, -1.0]) / np.sqrt(2.0)
"""Directions of the arms in base_link (x forward, y left)."""
_HOVER_SPEED = 512.0
"""rad/s: the default vehicle hovers at this speed with configuration 13."""


@dataclass(frozen=True)
class VehicleParams:
    """Rigid airframe and drive train of the simulated vehicle."""

    mass: float = param(
        1.3,
        "kg",
        (0.01, 10.0),
        "mass at take-off",
        "estimated, because: S500 frame 0.41, motors and ESCs 0.33, 3S battery 0.32, "
        "Pixhawk 4, Jetson TX2 and markers 0.24",
    )
    inertia_xx: float = param(
        0.0135,
        "kg m^2",
        (1e-6, 1.0),
        "moment of inertia about body x",
        "estimated, because: four 85 g drive units at 0.24 m give 0.0098, the hub 0.0037",
    )
    inertia_yy: float = param(
        0.0135, "kg m^2", (1e-6, 1.0), "moment of inertia about body y", "as inertia_xx"
    )
    inertia_zz: float = param(
        0.024,
        "kg m^2",
        (1e-6, 1.0),
        "moment of inertia about body z",
        "estimated, because: four 85 g drive units at 0.24 m give 0.0196, the hub 0.0044",
    )
    arm_length: float = param(
        0.24, "m", (0.02, 1.0), "centre to rotor axis", "S500 frame, 480 mm diagonal"
    )
    rotor_height: float = param(
        0.03,
        "m",
        (-0.2, 0.2),
        "disc plane above the centre of mass",
        "estimated, because: motors stand on the arms, battery and computer hang below",
    )
    rotor_radius: float = param(
        0.1111,
        "m",
        (0.005, 0.5),
        "tip radius; it must agree with the propeller's",
        "paper's 9-inch blade",
    )
    nodus_radius: float = param(
        0.035,
        "m",
        (0.001, 0.4),
        "radius at which a folded blade ends",
        "paper: outer end of the nodus r_N = 35 mm",
    )
    rotor_inertia: float = param(
        6.0e-5,
        "kg m^2",
        (1e-9, 1e-2),
        "inertia of propeller and motor bell about the axis",
        "propeller.rotor_inertia: wings of 5.715 g 5.45e-5, roots 0.15e-5, bell 0.4e-5 estimated",
    )
    motor_time_constant: float = param(
        0.035,
        "s",
        (0.001, 0.5),
        "first-order lag of rotor speed",
        "estimated, because: X2212-class motors with 9-inch propellers are given 20 to 50 ms",
    )
    rotor_speed_min: float = param(
        100.0,
        "rad/s",
        (0.0, 3000.0),
        "idle speed of an armed rotor",
        "estimated, because: ESCs of this class idle at about 1000 rpm",
    )
    rotor_speed_max: float = param(
        820.0,
        "rad/s",
        (100.0, 6000.0),
        "highest commanded rotor speed",
        "estimated, because: 960 KV at 12 V turns 11 520 rpm unloaded, two thirds under load",
    )
    arm_radius: float = param(
        0.02,
        "m",
        (0.001, 0.1),
        "half thickness of arms and motor mounts",
        "S500 frame, motor 27 mm",
    )
    leg_spread: float = param(
        0.12, "m", (0.005, 0.5), "landing-gear contact points at (+-s, +-s)", "S500 landing gear"
    )
    leg_height: float = param(
        0.18, "m", (0.005, 0.5), "contact points below the centre of mass", "S500 landing gear"
    )
    ground_stiffness: float = param(
        3000.0,
        "N/m",
        (1.0, 1e5),
        "stiffness of one contact point on the ground",
        "estimated, because: 1 mm of sag a leg at rest",
    )
    ground_damping: float = param(
        60.0,
        "N s/m",
        (0.0, 1000.0),
        "damping of one contact point on the ground",
        "estimated, because: a landing at 0.5 m/s should not bounce",
    )
    friction: float = param(
        0.4,
        "1",
        (0.0, 2.0),
        "Coulomb friction of frame and legs",
        "estimated, because: plastic on concrete or wood",
    )
    battery_voltage: float = param(
        12.6, "V", (3.0, 60.0), "open-circuit voltage, full", "3S pack; the paper says 12 V"
    )

    def hover_thrust(self) -> float:
        """Thrust of one rotor in hover [N]."""
        return self.mass * GRAVITY / 4.0

    def rotor_positions(self) -> Array:
        """Hub positions (4, 3) in base_link [m], from the geometric centre."""
        z = np.full(4, self.rotor_height)
        return np.column_stack([self.arm_length * ARM_X, self.arm_length * ARM_Y, z])


def similar_vehicle(
    mass: float, arm_length: float, rotor_radius: float, hover_speed: float | None = None
) -> VehicleParams:
    """Return the default vehicle scaled to another size, for unknown parameters.

    Lengths go with the arm, those of the rotor with its radius; moments of inertia with mass and
    arm squared, that of a rotor with the fifth power of its radius (equal material); the ground's
    stiffness and damping with the mass, so that legs sag by the same millimetre; rotor speeds with
    the speed in hover. At the default's own sizes it is the default, to the last bit.

    Args:
        mass: at take-off [kg].
        arm_length: centre to rotor axis [m].
        rotor_radius: tip radius [m].
        hover_speed: rotor speed in hover [rad/s]; None: rotor speeds as the default's.
    """
    like = VehicleParams()
    heavy, long = mass / like.mass, arm_length / like.arm_length
    wide = rotor_radius / like.rotor_radius
    fast = 1.0 if hover_speed is None else hover_speed / _HOVER_SPEED
    return VehicleParams(
        mass=mass,
        inertia_xx=like.inertia_xx * heavy * long**2,
        inertia_yy=like.inertia_yy * heavy * long**2,
        inertia_zz=like.inertia_zz * heavy * long**2,
        arm_length=arm_length,
        rotor_height=like.rotor_height * long,
        rotor_radius=rotor_radius,
        nodus_radius=like.nodus_radius * wide,
        rotor_inertia=like.rotor_inertia * wide**5,
        rotor_speed_min=like.rotor_speed_min * fast,
        rotor_speed_max=like.rotor_speed_max * fast,
        arm_radius=max(like.arm_radius * long, 0.001),
        leg_spread=like.leg_spread * long,
        leg_height=like.leg_height * long,
        ground_stiffness=like.ground_stiffness * heavy,
        ground_damping=like.ground_damping * heavy,
    )


@dataclass(frozen=True)
class DriveParams:
    """Thrust of one rotor: (offset + gain · command + curvature · command²) · supply's share.

    The supply's share is (voltage / supply)^supply_exponent.
    """

    gain: float = param(
        0.0, "N", (0.0, 1000.0), "thrust of one rotor per command from 0 to 1; 0: not known"
    )
    offset: float = param(0.0, "N", (-1000.0, 1000.0), "thrust of one rotor at command 0")
    curvature: float = param(
        0.0, "N", (0.0, 1000.0), "thrust of one rotor per square of the command"
    )
    supply_exponent: float = param(
        0.0, "1", (-4.0, 4.0), "how thrust grows with the voltage; 0: it is compensated"
    )
    supply: float = param(1.0, "V", (0.1, 1000.0), "voltage at which gain and offset hold")

    @property
    def known(self) -> bool:
        """Whether it says anything."""
        return max(self.gain, self.curvature) > 0.0

    def thrust(self, command: Array, voltage: Array | None = None) -> Array:
        """Return the thrust [N] of each rotor, never below 0.

        Args:
            command: (N, 4) from 0 to 1.
            voltage: (N,) [V]; None: as at `supply`.
        """
        command = np.asarray(command)
        thrust = self.offset + self.gain * command + self.curvature * command**2
        if voltage is not None and self.supply_exponent:
            thrust = thrust * ((voltage / self.supply) ** self.supply_exponent)[:, None]
        return np.asarray(np.maximum(thrust, 0.0))
