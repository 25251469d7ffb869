"""The simulator link: PX4 is the client of a TCP server, one at a time."""

from __future__ import annotations

from typing import NamedTuple

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_px4.link.mavlink_link import Link

PX4_PORT = 4560
"""Of PX4 instance 0; instance N asks for this port plus N."""
SYSTEM, COMPONENT = 1, 200
"""MAVLink ids that PX4's simulators use."""


class ActuatorControls(NamedTuple):
    """A HIL_ACTUATOR_CONTROLS."""

    time_us: int
    controls: tuple[float, ...]
    """Of PX4's motors 1 to 4, unchecked."""
    armed: bool


class HilLink(Link):
    """The server's side of PX4's TCP connection.

    Attributes:
        port: the one listened on.
    """

    def __init__(self, port: int = PX4_PORT) -> None:
        """Listen on this machine. Port 0 takes a free one.

        Raises:
            InputError: the port is taken or not allowed.
        """
        if not 0 <= port <= 65535:
            raise InputError(f"port {port} is out of bounds; accepted: 0 to 65535")
        url = f"tcpin://127.0.0.1:{port}"
        # PX4's messages carry the simulation's time: their arrival is not read.
        super().__init__(url, system=SYSTEM, component=COMPONENT, clock=lambda: 0)
        self.port = self.address[1] if self.address else port

    def receive_controls(self) -> list[ActuatorControls]:
        """Return the received actuator controls."""
        connections = self.opened
        answers = []
        for message in (received.message for received in self.receive()):
            if message.get_msgId() == mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                armed = bool(message.mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
                controls = tuple(message.controls[:4])
                answers.append(ActuatorControls(int(message.time_usec), controls, armed))
        if self.opened != connections:  # another client: nothing of the one before counts
            return []
        return answers
