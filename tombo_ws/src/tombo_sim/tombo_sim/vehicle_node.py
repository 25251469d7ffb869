"""Base of the nodes that simulate the vehicle: its world, and the topics that a lab sees.

The topics are the motion capture's poses, the markers of the obstacle and `ground_truth/`. Each
node adds its own pilot and sensors.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from tombo_bag.markers import obstacle_marker
from tombo_bag.topics import MARKERS, MOCAP_POSE, TRUE_CONTACT, TRUE_ODOMETRY, TRUE_ROTORS
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import Contact, Odometry, Pose, RotorState
from tombo_dynamics.plant import Plant
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_dynamics.time_base import SECOND_NS, TICK_HZ, TICK_NS
from tombo_dynamics.vehicle import VehicleParams
from tombo_ros.node_loop import LoopNode
from tombo_ros.pacing import SIMULATOR
from tombo_sim.ground_truth import contact_force, true_state
from tombo_sim.propeller_effects import vehicle_effects
from tombo_sim.simulator import Simulator
from tombo_sim.world import ObstacleParams, SpreadParams, World

_TRUTH_TICKS = round(TICK_HZ / TRUE_ODOMETRY.rate_hz)
_ALL_REPORT_NS = 1_200_000_000
"""Each node reports once a second: by then all have sent a report to the last that came."""


class VehicleNode(LoopNode):
    """The node `sim`: makes a vehicle of `world` and `seed` and publishes each tick of it."""

    catches_up = True
    simulator: Simulator
    """The vehicle, once it is presented."""

    def __init__(self, more: Mapping[str, Any] | None = None) -> None:
        """Declare the parameters of the world.

        Args:
            more: section → record of further parameters.

        Raises:
            InputError: a parameter is refused.
        """
        records = {
            "vehicle": VehicleParams(),
            "propeller": PropellerChoice(),
            "obstacle": ObstacleParams(),
            "spread": SpreadParams(),
            **(more or {}),
        }
        super().__init__("sim", 1000.0, records, fixed=records, priority=SIMULATOR)
        self.seed = int(self.declare("seed", 0, "all chance comes from it", bounds=(0, 2**53)))
        mocap_rate = self.declare(
            "mocap_rate", 30.0, "rate of the motion capture [Hz]", bounds=(5.0, 500.0)
        )
        names = self.declare(
            "starts_after",
            "",
            "in real time: names of nodes, with spaces between them; the flight begins when each "
            "has reported on /diagnostics",
        )
        self.start_patience_s = self.declare(
            "start_patience",
            120.0,
            "wall time [s] until the others must be ready; they may have to compile. In lockstep "
            "the simulator then ends, in real time it begins without them",
            bounds=(0.1, 3600.0),
        )
        start_x, start_y = (
            self.declare(f"start_{axis}", 0.0, f"start [m], map {axis}", bounds=(-1e3, 1e3))
            for axis in "xy"
        )
        self._awaited = set(names.split())
        self._made_ns = time.time_ns()
        self._begins_ns = 0
        self.world = replace(self._world(mocap_rate), start=(start_x, start_y))
        self._state = np.zeros(13)

    def others_ready(self, now_ns: int) -> bool:
        """Return whether the nodes to wait for are there, and have met each other."""
        if self._awaited:
            for report in self.reports.take():
                self._awaited.difference_update(status.name for status in report.message.status)
            in_vain = now_ns - self._made_ns > self.start_patience_s * SECOND_NS
            self.health.fault(
                "nodes_missing",
                in_vain and bool(self._awaited),
                f"the flight begins without {', '.join(sorted(self._awaited))}",
            )
            if in_vain:
                self._awaited.clear()
            self._begins_ns = now_ns + _ALL_REPORT_NS
        return now_ns >= self._begins_ns

    def _world(self, mocap_rate: float) -> World:
        """Declare the parameters of all effects; defaults follow from the propeller."""
        derived = vehicle_effects(self.records["propeller"], self.records["vehicle"], {})
        effects = {}
        for effect in REGISTRY.values():
            defaults = derived.get(effect.name, {})
            effects[effect.name] = {
                p.name: self.declare(
                    f"effects.{effect.name}.{p.name}",
                    float(defaults.get(p.name, p.null)),
                    f"{p.doc} [{p.unit}]",
                    bounds=p.bounds,
                )
                for p in effect.theta
            }
        r = self.records
        return World(r["vehicle"], r["propeller"], r["obstacle"], r["spread"], effects, mocap_rate)

    def log(self, text: str, severe: bool) -> None:
        """Put a text into the log, as a warning if it is severe."""
        logger = self.ros.get_logger()
        if severe:  # rclpy: one severity for each line of code
            logger.warning(text)
        else:
            logger.info(text)

    def offer_hand(self, hand: Any) -> None:
        """Offer a service that lets a simulated hand (`HandMotion`) move the vehicle."""

        def move(_: Any, response: Any) -> Any:
            hand.asked = response.success = True
            response.message = "a hand carries and turns the vehicle"
            return response

        self.ros.create_service(Trigger, "sim/hand", move)

    def attach_simulator(self, simulator: Simulator) -> None:
        """Take the vehicle that is to be shown, and advertise the topics."""
        contact_force(simulator.plant)  # compiled code is loaded now, not at the first touch
        true_state(simulator.plant, self._state)
        self._pose_out = self.advertise(MOCAP_POSE)
        self._odometry_out = self.advertise(TRUE_ODOMETRY)
        self._rotors_out = self.advertise(TRUE_ROTORS)
        self._contact_out = self.advertise(TRUE_CONTACT)
        self._markers = self.advertise(MARKERS)
        self.replace_simulator(simulator)

    @property
    def poses_sent(self) -> int:
        """How many poses were published."""
        return self._pose_out.sent

    def replace_simulator(self, simulator: Simulator) -> None:
        """Take another vehicle, which is shown from now on."""
        self.simulator = simulator
        self._touched = False

    def publish_obstacle(self, stamp_ns: int) -> None:
        """Publish the obstacle's marker, if there is an obstacle."""
        obstacle = self.simulator.setup.obstacle
        if obstacle[2] > 0.0:  # its radius
            self._markers.publish(obstacle_marker(stamp_ns, obstacle))

    def publish_tick(self, began_ns: int) -> None:
        """Publish what a lab sees of the present tick, and the ground truth.

        Args:
            began_ns: time of tick 0.
        """
        plant, tick = self.simulator.plant, self.simulator.tick
        stamp = began_ns + tick * TICK_NS
        for sample in self.simulator.arrived:
            pose = (FRAME_MAP, sample.pose[:3], sample.pose[3:])
            self._pose_out.send(Pose(began_ns + sample.stamp_ns, *pose))
        if tick % _TRUTH_TICKS == 0:
            self._publish_truth(stamp, plant)
        self._publish_contact(stamp, plant)

    def _publish_truth(self, stamp: int, plant: Plant) -> None:
        state = self._state
        true_state(plant, state)
        self._odometry_out.send(Odometry(stamp, state[:3], state[3:7], state[7:10], state[10:]))
        rotors = (plant.rotor_speed, plant.rotor_thrust, plant.fold, plant.damage)
        self._rotors_out.send(RotorState(stamp, *rotors))

    def _publish_contact(self, stamp: int, plant: Plant) -> None:
        touching = bool(plant.contact.touching)
        if touching or self._touched:
            rotor, force = int(plant.contact.rotor), np.array(contact_force(plant))
            self._contact_out.send(Contact(stamp, touching, rotor, force, plant.contact.point))
        self._touched = touching

    def report(self, now_ns: int) -> None:
        """Add how far the flight is."""
        self.health.value("tick", self.simulator.tick)
        super().report(now_ns)
