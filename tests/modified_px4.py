"""The simulated PX4 for tests of the bridge: its messages in both directions pass through here.

A test drops or alters messages, and refuses commands; all the rest is the endpoint's own.
"""

from collections import deque

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.records import numbers
from tombo_px4.autopilot.parameters import FLOWN_BY_POSES, ParameterTable
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.link.mavlink_link import Received
from tombo_px4.modes import custom_mode
from tombo_px4.protocol.endpoint import Endpoint
from tombo_sim.world import SpreadParams, World

BRIDGE = (245, 191)
WORLD = World(spread=SpreadParams(start=0.0, yaw=0.0, obstacle=0.0))


class ModifiedPx4:
    """Endpoint and vehicle; it is the endpoint's link, in memory or in front of a real one."""

    def __init__(self, now_ns, link=None, **parameters):
        self.link = link
        self.table = ParameterTable()
        for name, value in (FLOWN_BY_POSES | parameters).items():
            self.table.store(name, value)
        self.mute = set()
        """Messages that it does not send, unless they are asked for."""
        self.deaf = lambda message: False
        """Whether it does not hear a message."""
        self.silent = False
        self.shows = None
        """A mode that its heartbeats show in place of its own."""
        self.refuses = {}
        """Command -> result, of commands that are not carried out."""
        self.failing = []
        """Checks that it reports as failed, in place of its own."""
        self.received, self.targets, self.stamps = [], [], []
        """Messages; set points; capture on our clock as PX4 thinks, and arrival, of each pose."""
        self._came, self._out = deque(), []
        self.boot(now_ns)

    def boot(self, now_ns):
        """Begin on the ground, with a new clock."""
        self.ahead_ns = -now_ns
        """Its clock against ours."""
        self._now_ns = now_ns
        self.vehicle = Px4Vehicle(WORLD, 3, self.table)
        self.endpoint = Endpoint(self.vehicle, [(self, "onboard")])

    @property
    def place(self):
        return numbers(self.vehicle.simulator.plant.state)[:3].copy()

    @property
    def attitude(self):
        return numbers(self.vehicle.simulator.plant.state)[6:10].copy()

    @property
    def armed(self):
        return self.vehicle.armed

    @property
    def mode(self):
        return self.vehicle.mode

    # --- the endpoint's link

    def receive(self, limit=100):
        """Return the received messages that pass."""
        if self.link is not None:
            for received in self.link.receive(limit):
                self.take(received.message, received.arrival_ns)
        heard, self._came = list(self._came), deque()
        return heard

    def send(self, message, to=None):
        """Send what is not muted."""
        kind = message.get_type()
        if self.silent or (to is None and kind in self.mute):
            return
        if kind == "HEARTBEAT" and self.shows is not None:
            message.custom_mode = custom_mode(self.shows)
        if self.link is not None:
            self.link.send(message)
        self._out.append(message)

    # --- what happens to it

    def take(self, message, now_ns):
        """Take a message that arrives now."""
        kind = message.get_type()
        self.received.append(message)
        if kind.startswith("SET_"):
            self.targets.append(message)
        command = message.command if kind == "COMMAND_LONG" else None
        if command in self.refuses:
            self.say("Arming denied: Resolve system health failures first\t", 2)
            ack = mav.MAVLink_command_ack_message(command, self.refuses[command], 0, 0, *BRIDGE)
            self.send(ack, "bridge")
        elif command == mav.MAV_CMD_RUN_PREARM_CHECKS and self.failing:
            for check in self.failing:
                self.say(f"Preflight Fail: {check}", 2)
        elif not self.deaf(message):
            self._came.append(Received(message, now_ns, *BRIDGE, "bridge"))

    def fly(self, now_ns):
        """Go on to now; return the messages it sends."""
        vision = self.vehicle.vision

        def watched(boot_us, position, attitude):
            self.stamps.append((boot_us * 1000 - self.ahead_ns, now_ns))
            return vision(boot_us, position, attitude)

        self.vehicle.vision = watched
        self.endpoint.advance(now_ns + self.ahead_ns, now_ns)
        del self.vehicle.vision
        out, self._out = self._out, []
        return out

    def say(self, text, severity=6):
        """Send a text, where a ground station is heard."""
        for chunk, first in enumerate(range(0, len(text), 50)):
            content = (severity, text.encode()[first : first + 50], 77, chunk)
            if self.endpoint.channels[0].hears_station(self.vehicle.boot_us):
                self.send(mav.MAVLink_statustext_message(*content))

    def push(self, velocity):
        """Add a velocity (3) [m/s] to the vehicle's."""
        state = self.vehicle.simulator.plant.state
        state.velocity = state.velocity + np.array(velocity)
