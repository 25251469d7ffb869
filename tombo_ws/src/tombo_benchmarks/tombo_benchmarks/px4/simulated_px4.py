"""The simulated PX4 in the time of a lockstep flight: no socket, no clock, no chance but seeds."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.hil.flight import Watch
from tombo_px4.link.framing import FrameCounts, decode, encoder, frames_of
from tombo_px4.link.mavlink_link import Received
from tombo_px4.protocol.endpoint import Endpoint
from tombo_sim.world import World


class MemoryLink:
    """One end of a MAVLink link within the process: as much of `Link` as is used, no socket."""

    def __init__(self, system: int, component: int) -> None:
        self.mav = encoder(system, component)
        self.now_ns = EPOCH_NS
        """Time that arrivals are stamped with; the owner sets it."""
        self._other: MemoryLink | None = None
        self._came: deque[Received] = deque()

    @classmethod
    def pair(cls, here: tuple[int, int], there: tuple[int, int]) -> tuple[MemoryLink, MemoryLink]:
        """Return both ends of a link between two systems and components."""
        ends = cls(*here), cls(*there)
        ends[0]._other, ends[1]._other = ends[1], ends[0]
        return ends

    def send(self, message: Any, to: Any = None) -> bool:
        """Send a message; it is there at once."""
        assert self._other is not None
        self._other.arrive(bytes(message.pack(self.mav)))
        self.mav.seq = (self.mav.seq + 1) % 256
        return True

    def arrive(self, data: bytes) -> None:
        """Take the bytes of one message."""
        for frame in frames_of(data, FrameCounts()):
            ids = (frame.system, frame.component)
            self._came.append(Received(decode(frame), self.now_ns, *ids, None))

    def receive(self, limit: int = 200) -> list[Received]:
        """Return the messages that have come."""
        return [self._came.popleft() for _ in range(min(limit, len(self._came)))]

    def close(self) -> None:
        """Forget what has come."""
        self._came.clear()


class SimulatedPx4:
    """The simulated PX4 and its vehicle; `advance` is a tick."""

    missed = 0
    """It answers every step."""

    def __init__(
        self,
        world: World,
        seed: int,
        parameters: Mapping[str, float],
        watch: Watch,
        hand: Watch | None = None,
        own: tuple[int, int] = (245, 191),
    ) -> None:
        """Set the vehicle on the ground.

        Args:
            world: what is simulated.
            seed: of all random draws.
            parameters: of PX4, over its defaults.
            watch: called at every tick after the first.
            hand: the same, before the autopilot takes the samples of the tick.
            own: system and component of the client.
        """
        table = ParameterTable()
        for name, value in parameters.items():
            table.set(name, value)
        self.vehicle = Px4Vehicle(world, seed, table)
        self.link, self._link = MemoryLink.pair(own, (1, 1))
        self._endpoint = Endpoint(self.vehicle, [(self._link, "onboard")])  # type: ignore[list-item]
        self.vehicle.hand = hand
        self._watch = watch

    @property
    def motors(self) -> Px4Vehicle:
        """Whether it is armed."""
        return self.vehicle

    @property
    def steps(self) -> int:
        """Ticks flown."""
        return self.vehicle.tick

    def advance(self) -> None:
        """Fly a tick."""
        boot_ns = (self.vehicle.tick + 1) * TICK_NS
        self.link.now_ns = self._link.now_ns = EPOCH_NS + boot_ns
        self._endpoint.advance(boot_ns, EPOCH_NS + boot_ns)
        self._watch(self.vehicle.simulator)
