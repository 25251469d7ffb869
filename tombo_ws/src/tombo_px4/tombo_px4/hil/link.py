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


class HilLink:
    """The server's side of PX4's TCP connection. Polled; only `wait` blocks.

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
        # PX4's messages carry the simulation's time: their arrival is not read.
        self._link = Link(
            f"tcpin://127.0.0.1:{port}", system=SYSTEM, component=COMPONENT, clock=lambda: 0
        )
        self.port = self._link.address[1] if self._link.address else port

    @property
    def connected(self) -> bool:
        """Whether PX4 is there."""
        return self._link.connected

    @property
    def connections(self) -> int:
        """How many connections there have been."""
        return self._link.opened

    @property
    def counters(self) -> dict[str, int]:
        """Counts of what has come and was refused."""
        return self._link.counters

    def wait(self, timeout_s: float) -> None:
        """Sleep until something comes or the time is over."""
        self._link.wait(timeout_s)

    def receive(self) -> list[ActuatorControls]:
        """Return the received actuator controls."""
        connections = self.connections
        answers = []
        for received in self._link.receive():
            message = received.message
            if message.get_msgId() == mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                armed = bool(message.mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
                controls = tuple(message.controls[:4])
                answers.append(ActuatorControls(int(message.time_usec), controls, armed))
        if self.connections != connections:  # another client: nothing of the one before counts
            return []
        return answers

    def send(self, data: bytes) -> None:
        """Send frames to PX4, later if the socket is full."""
        self._link.send_frames(data)

    def close(self) -> None:
        """Close the port."""
        self._link.close()
