"""The vehicle of a real PX4, as a node: physics behind PX4's simulator link, and the mocap for it.

PX4 connects to the port, in lockstep, and flies; its other links are its own. Poses of the motion
capture leave by ROS, so the bridge brings them to PX4 as it would in the lab. Real time only.
"""

from __future__ import annotations

import time

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import TICK_NS
from tombo_px4.hil.flight import PX4_PORT, HilFlight
from tombo_px4.hil.hand_motion import HandMotion
from tombo_px4.hil.lockstep import HilSimulator
from tombo_ros.core_node import main_of
from tombo_sim.simulator import Simulator
from tombo_sim.vehicle_node import VehicleNode

_MOST_STEPS = 20
"""In one run of the loop."""
_FAR_NS = 100_000_000
"""If the clocks differ by more, the flight's clock is set; below, it is adjusted."""
_FOLLOWS = 64
"""Ticks in which a difference of the clocks is corrected."""


class HilSimNode(VehicleNode):
    """The simulator link at 1 kHz."""

    catches_up = False

    def __init__(self) -> None:
        """Declare parameters, listen for PX4, set the vehicle on the ground.

        Raises:
            InputError: a parameter is refused, the port is taken, or the world can't be.
        """
        super().__init__()
        if self.sim_time:
            raise InputError("use_sim_time true: PX4 flies in real time; accepted: false")
        port = self.declare(
            "port", PX4_PORT, "TCP port for PX4's simulator link", bounds=(1, 65535)
        )
        hand_at = self.declare(
            "hand_at",
            0.0,
            "a simulated hand moves the vehicle so long after PX4 has connected, which proves the"
            " axes of the poses; 0: none does",
            bounds=(0.0, 600.0),
        )
        hand = HandMotion(hand_at) if hand_at > 0.0 else HandMotion()
        self.offer_hand(hand)
        self._hil = HilSimulator(
            lambda: HilFlight(self.world, self.seed, watch=self._watch, hand=hand),
            port,
            tell=self.log,
        )
        self.attach_simulator(self._hil.flight.simulator)
        self._began_ns = 0
        """Time of tick 0."""

    def begin(self) -> None:
        """Show the obstacle, then wait for PX4."""
        self.publish_obstacle(time.time_ns())
        super().begin()

    def step(self, now_ns: int) -> None:
        """Fly the steps that are due."""
        for _ in range(_MOST_STEPS):
            if not self._hil.advance(time.monotonic_ns()):
                break

    def _watch(self, simulator: Simulator) -> None:
        """Show a tick. Its time is the system's, as smooth as PX4's own clock."""
        if simulator is not self.simulator:
            self.replace_simulator(simulator)
            self.publish_obstacle(time.time_ns())
        off_ns = time.time_ns() - (self._began_ns + simulator.tick * TICK_NS)
        self._began_ns += off_ns if abs(off_ns) > _FAR_NS else off_ns // _FOLLOWS
        if self.others_ready(time.time_ns()):
            self.publish_tick(self._began_ns)

    def report(self, now_ns: int) -> None:
        """Add the state of the connection to PX4."""
        hil = self._hil
        self.health.value("px4", hil.phase.value)
        for name in ("flights", "steps", "missed", "wrong_time", "slips"):
            self.health.value(name, getattr(hil, name))
        for name, count in hil.link.counters.items():
            if count:
                self.health.value(f"link.{name}", count)
        super().report(now_ns)

    def close(self) -> None:
        """Close the port."""
        self._hil.close()


main = main_of(HilSimNode)


if __name__ == "__main__":
    main()
