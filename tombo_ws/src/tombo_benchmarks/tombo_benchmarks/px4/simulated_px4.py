"""The simulated PX4 in the time of a lockstep flight: no socket, no clock, no chance but seeds."""

from __future__ import annotations

from collections.abc import Mapping

from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.hil.flight import Watch
from tombo_px4.link.memory_link import MemoryLink
from tombo_px4.protocol.endpoint import Endpoint
from tombo_sim.world import World


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
