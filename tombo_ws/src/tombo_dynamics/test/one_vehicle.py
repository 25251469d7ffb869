"""One simulated vehicle in a test's hands: make it, put it somewhere, fly it tick by tick."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_dynamics.effects.compose import apply_mocap, new_plant, pack_theta
from tombo_dynamics.plant import set_state
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.records import numbers
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotor_maps import rotor_maps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, SPIN, VehicleParams

TICK = 1e-3
NOISE = 9
QUIET = np.zeros(NOISE)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@cache
def tombo_maps():
    return rotor_maps(thrust_map(configuration(13)), VehicleParams())


@cache
def vacuum_maps():
    table = tombo_maps().copy()
    table.thrust = 0.0
    table.torque = 0.0
    return table


class Vehicle:
    """A plant with the theta and the maps that it flies with."""

    def __init__(
        self,
        effects=None,
        params=None,
        maps=None,
        tick=TICK,
        position=(0.0, 0.0, 10.0),
        velocity=(0.0, 0.0, 0.0),
        attitude=UPRIGHT,
        rates=(0.0, 0.0, 0.0),
        speed=0.0,
        obstacle=(0.0, 0.0, 0.0, 0.0),
        draws=None,
        theta=None,
    ):
        self.params = params or VehicleParams()
        self.maps = tombo_maps() if maps is None else maps
        self.theta = pack_theta(effects or {}) if theta is None else theta
        self.tick = tick
        self.plant = new_plant(self.params)
        self.body = [*position, *velocity, *attitude, *rates]
        self.plant.obstacle = tuple(obstacle)
        if draws is not None:
            self.plant.draws = draws
        begin_flight(self.plant, QUIET, self.theta, tick)
        self.spin_up(speed)

    @property
    def body(self):
        """Position, velocity, quaternion and rates (13): a copy."""
        return numbers(self.plant.state)

    @body.setter
    def body(self, values):
        set_state(self.plant.state, np.array(values, dtype=float))

    @property
    def wrench(self):
        return np.concatenate((self.plant.force, self.plant.moment))

    @property
    def imu(self):
        return np.concatenate((self.plant.gyro, self.plant.accel))

    @imu.setter
    def imu(self, values):
        self.plant.gyro, self.plant.accel = values[:3], values[3:]

    def spin_up(self, speed):
        """Let the rotors turn at `speed` [rad/s], and go on asking for it."""
        self.plant.rotor_speed = speed
        self.plant.rotor_command = speed
        self.plant.past_commands[:] = speed

    def begin(self, noise=QUIET):
        begin_tick(self.plant, self.maps, noise, self.theta)

    def finish(self, noise=QUIET):
        finish_tick(self.plant, noise, self.theta)

    def fly(self, seconds, command=None, noise=None, watch=None):
        """Fly on; `command(k)` gives rotor speeds, `noise[k]` a tick's normals.

        Returns what `watch(self)`, called between the two halves of each tick, has returned.
        """
        seen = []
        for k in range(round(seconds / self.tick)):
            if command is not None:
                self.plant.rotor_command = command(k)
            normals = QUIET if noise is None else noise[k]
            begin_tick(self.plant, self.maps, normals, self.theta)
            if watch is not None:
                seen.append(watch(self))
            finish_tick(self.plant, normals, self.theta)
        return np.array(seen)

    # --- what a physicist would ask of it ---------------------------------------------------

    @property
    def position(self):
        return self.plant.state.position

    @property
    def velocity(self):
        return self.plant.state.velocity

    @property
    def rates(self):
        return self.plant.state.rates

    @property
    def rotation(self):
        return Rotation.from_quat(self.plant.state.attitude)

    @property
    def mass(self):
        return self.plant.mass

    @property
    def inertia(self):
        return self.plant.inertia

    def kinetic_energy(self):
        """Return translation plus rotation of the airframe [J]; rotors' spin left out."""
        return 0.5 * self.mass * (self.velocity @ self.velocity) + self.rotation_energy()

    def rotation_energy(self):
        return 0.5 * self.inertia @ self.rates**2

    def energy(self):
        """Return kinetic and potential energy [J]; rotors' spin left out."""
        return self.kinetic_energy() + self.mass * GRAVITY * self.position[2]

    def rotor_momentum(self):
        """Return the spin momentum of the rotors along body z [kg m^2/s]."""
        return self.params.rotor_inertia * SPIN @ self.plant.rotor_speed

    def angular_momentum(self):
        """Return that of airframe and rotors about the centre of mass, in map [kg m^2/s]."""
        body = self.inertia * self.rates
        body[2] += self.rotor_momentum()
        return self.rotation.apply(body)


def hover_speed(params=None):
    params = params or VehicleParams()
    return speed_for_thrust(tombo_maps(), params.hover_thrust())


def random_attitude(rng):
    q = rng.standard_normal(4)
    return q / np.linalg.norm(q)


def as_rotation(yaw, roll, pitch):
    """Return the turn about z, then the new y, then the new x."""
    return Rotation.from_euler("ZYX", [yaw, pitch, roll])


def measured_pose(effects, position=(0.0, 0.0, 0.0), attitude=(0.0, 0.0, 0.0, 1.0), noise=QUIET):
    """Return the motion capture's sample of a pose."""
    v = Vehicle(effects)
    v.plant.mocap.position = position
    v.plant.mocap.attitude = attitude
    apply_mocap(v.plant, noise, v.theta)
    return v.plant.mocap.copy()
