"""The simulated PX4 as a node: autopilot and vehicle behind MAVLink, and the motion capture.

It takes no rotor commands: it is flown over its links, as a real PX4. Poses of the motion capture
are published in ROS only; PX4 gets them from the bridge. Real time only.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import TICK_NS
from tombo_px4.autopilot.parameters import FLOWN_BY_POSES, PARAMETERS, ParameterTable
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.hil.hand_motion import HandMotion
from tombo_px4.link.mavlink_link import Link, read_key
from tombo_px4.modes import OFFBOARD, Severity, mode_name
from tombo_px4.protocol.endpoint import Endpoint
from tombo_ros.core_node import main_of
from tombo_sim.vehicle_node import VehicleNode
from tombo_sim.world import World

_BEHIND_NS = 500_000_000
"""If it is behind or ahead by more, the flight's clock is set; a smaller delay, as when other
nodes start, is caught up within a tenth of a second."""
_LIFTED_M, _WARM_UP_TICKS, _TRY_TICKS = 0.02, 10_000, 50
"""Of the warm-up: a height, the most ticks, and how often it tries to begin."""
_LINKS = (
    ("onboard", 14540, "link of an on-board computer"),
    ("ground", 14550, "link of a ground station"),
)
_MOST_TICKS = 20
"""Most ticks in one run of the loop; links are read between the runs."""


def warm_up(world: World) -> Px4Vehicle:
    """Load all compiled code before the flight: fly a spare vehicle until it has lifted off."""
    table = ParameterTable()
    for name, value in FLOWN_BY_POSES.items():
        table.store(name, value)
    spare = Px4Vehicle(world, 0, table)
    up = OffboardSetpoint(position=spare.home + np.array([0.0, 0.0, 2.0]), yaw=0.0)
    ground = spare.simulator.height
    while spare.simulator.height < ground + _LIFTED_M and spare.tick < _WARM_UP_TICKS:
        for sample in spare.simulator.arrived:
            spare.vision(sample.captured * 1000, sample.pose[:3], sample.pose[3:])
        if spare.tick % _TRY_TICKS == 0:
            spare.target(up)
            spare.set_mode(OFFBOARD)
            spare.arm()
        spare.step()
    return spare


class Px4SimNode(VehicleNode):
    """The endpoint and the motion capture, at 1 kHz."""

    catches_up = False

    def __init__(self) -> None:
        """Declare parameters, open the links, set the vehicle on the ground.

        Raises:
            InputError: a parameter is refused, a link can't be opened, or the world can't be.
        """
        super().__init__()
        if self.sim_time:
            raise InputError("use_sim_time true: a link to PX4 is in real time; accepted: false")
        urls = {
            kind: self.declare(f"{kind}_url", f"udpout://127.0.0.1:{port}", f"{doc}; empty: none")
            for kind, port, doc in _LINKS
        }
        key_file = self.declare("key_file", "", "32 bytes of the signing key; empty: not signed")
        remote = self.declare("allow_remote", False, "true: speak to other machines too")
        if not any(urls.values()):
            raise InputError("onboard_url and ground_url: both empty; accepted: at least one link")
        table = self._table()
        key = read_key(key_file, partial(self.health.fault, "key_file", True))
        self._links = {
            kind: Link(
                url,
                system=int(table.get("MAV_SYS_ID")),
                component=int(table.get("MAV_COMP_ID")),
                clock=time.time_ns,
                key=key,
                allow_remote=remote,
            )
            for kind, url in urls.items()
            if url
        }
        warm_up(self.world)
        self.vehicle = Px4Vehicle(self.world, self.seed, table)
        self.vehicle.hand = HandMotion()
        self.offer_hand(self.vehicle.hand)
        self.attach_simulator(self.vehicle.simulator)
        links = [(link, kind) for kind, link in self._links.items()]
        self._endpoint = Endpoint(self.vehicle, links, self._log_status_text)
        self._began_ns: int | None = None
        """Time of tick 0."""
        self._slipped = 0

    def _table(self) -> ParameterTable:
        """Declare PX4's parameters as `px4.NAME`; those of mocap alone are the default."""
        table = ParameterTable()
        for p in PARAMETERS:
            kind: Any = int if p.kind == "int32" else float
            default = kind(FLOWN_BY_POSES.get(p.name, p.default))
            text = f"{p.doc} [{p.unit}]" if p.unit else p.doc
            value = self.declare(f"px4.{p.name}", default, text, bounds=(p.low, p.high))
            table.store(p.name, value)
        return table

    def begin(self) -> None:
        """Show the obstacle, then fly."""
        self._began_ns = time.time_ns()
        self.publish_obstacle(self._began_ns)
        super().begin()

    def step(self, now_ns: int) -> None:
        """Fly up to now, and answer the messages of the links.

        PX4 is on from the start; the motion capture sees it once the other nodes are there.
        """
        assert self._began_ns is not None
        seen = self.others_ready(now_ns)
        behind_ns = now_ns - self._began_ns - self.vehicle.tick * TICK_NS
        if abs(behind_ns) > _BEHIND_NS:
            self._began_ns += behind_ns  # missed ticks are dropped
            self._slipped += 1
            late = f"the loop was {behind_ns * 1e-9:.2f} s behind the clock"
            self.health.report_event("slipped", f"{late}: flight time stood still")
            behind_ns = 0
        if behind_ns < TICK_NS:
            self._endpoint.advance(self.vehicle.tick * TICK_NS, now_ns)
        for _ in range(min(behind_ns // TICK_NS, _MOST_TICKS)):
            self._endpoint.advance((self.vehicle.tick + 1) * TICK_NS, time.time_ns())
            if seen:
                self.publish_tick(self._began_ns)

    def _log_status_text(self, severity: int, text: str) -> None:
        self.log(f"PX4 says: {text}", severity <= Severity.WARNING)

    def report(self, now_ns: int) -> None:
        """Add the state of autopilot and links."""
        vehicle = self.vehicle
        self.health.value("armed", vehicle.armed)
        self.health.value("mode", mode_name(vehicle.mode))
        self.health.value("failsafe", vehicle.failsafe)
        self.health.value("slipped", self._slipped)
        for kind, link in self._links.items():
            for name, count in link.counters.items():
                if count:
                    self.health.value(f"{kind}.{name}", count)
        super().report(now_ns)

    def close(self) -> None:
        """Close the links."""
        for link in self._links.values():
            link.close()


main = main_of(Px4SimNode)


if __name__ == "__main__":
    main()
