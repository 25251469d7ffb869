"""Common parts of the tests of the simulator link: a world, a simulator and a PX4, polled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

from hil_peer import ALIGN, Peer

from tombo_flight.scenario import load_scenario, world_of
from tombo_px4.hil.flight import HilFlight
from tombo_px4.hil.lockstep import HilSimulator
from tombo_sim.world import World

TURN_NS = 20_000
"""Step of the benches' clock in each turn."""


def hover_world(*settings: str) -> World:
    return world_of(load_scenario("hover", settings))


class Bench:
    """Simulator and PX4 in one thread, over a real socket; time is made here."""

    def __init__(
        self,
        world: World | None = None,
        *,
        silent: int = 9,
        align: int = ALIGN,
        speed: float = 0.0,
    ) -> None:
        self.news: list[str] = []
        self.hil = HilSimulator(
            lambda: HilFlight(world or hover_world(), 1),
            0,
            speed,
            lambda text, _: self.news.append(text),
        )
        self.now_ns = 10**15
        self.peer = Peer(self.hil.port, silent, align)

    @property
    def height(self) -> float:
        return float(self.hil.flight.simulator.plant.state.position[2])

    @property
    def seconds(self) -> float:
        return 1e-6 * self.hil.flight.time_us

    def turn(self) -> bool:
        self.now_ns += TURN_NS
        stepped = self.hil.advance(self.now_ns)
        self.peer.pump()
        return stepped

    def until(self, enough: Callable[[], bool], turns: int = 200_000) -> None:
        for _ in range(turns):
            if enough():
                return
            self.turn()
        raise AssertionError(f"not in {turns} turns; {self.hil.phase}, news: {self.news}")

    def fly(self, seconds: float) -> None:
        """Go on to that time of the flight."""
        self.until(
            lambda: self.seconds >= seconds - 1e-9, turns=round(1e9 / TURN_NS * seconds) + 20_000
        )

    def hush(self) -> Callable[[Any], bytes | None]:
        """Let PX4 answer no more; return how it has answered."""
        kept, self.peer.answer = self.peer.answer, lambda sensor: None
        return kept

    def close(self) -> None:
        self.peer.close()
        self.hil.close()


@contextmanager
def bench(*args: Any, **kwargs: Any) -> Iterator[Bench]:
    with closing(Bench(*args, **kwargs)) as made:
        yield made
