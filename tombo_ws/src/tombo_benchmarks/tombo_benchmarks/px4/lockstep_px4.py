"""A PX4 whose vehicle is simulated here, in lockstep with it: a real one, or the simulated one."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tombo_benchmarks.px4.px4_process import Px4Process
from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.bridge.bridge_params import LinkParams
from tombo_px4.bridge.vehicle_parameters import MOCAP_ONLY, SAFE_PARAMETERS
from tombo_px4.hil.flight import PX4_PORT, HilFlight, Watch, airframe_parameters
from tombo_px4.hil.lockstep import HilSimulator
from tombo_px4.link.mavlink_link import Codec, Received
from tombo_px4.link.vehicle_link import open_link
from tombo_px4.protocol.endpoint import Endpoint
from tombo_sim.simulator import Simulator
from tombo_sim.world import World

ONBOARD_PORT = 14540
_SILENT_S = 60.0
"""Wall time without a step after which PX4 is given up."""
_WAIT_S = 0.02


@dataclass(frozen=True)
class Px4Setup:
    """Which PX4 flies, by motion capture alone."""

    build: Path | None
    """Of a real one (`px4_build`); None: the simulated one."""
    folder: Path
    """New; for the files of a real one."""
    seed: int = 0
    """Of the simulation's random draws."""
    instance: int = 0
    """Of a real one: its ports and its id."""

    @contextmanager
    def start(self, world: World, hand: Watch | None = None) -> Iterator[LockstepPx4]:
        """Give the PX4 with its vehicle; `hand` moves it before the samples of a tick.

        Raises:
            InputError: a port is taken.
        """
        if self.build is None:
            yield SimulatedPx4(world, self.seed, hand)
            return
        px4 = RealPx4(self, self.build, world, hand)
        try:
            yield px4
        finally:
            px4.close()


class RealPx4:
    """A PX4 SITL, over its simulator link and its on-board link.

    Attributes:
        link: the bridge's end of the link to it.
        system: its MAVLink system.
        watch: called with the simulator at every tick; a restarted PX4 has a new simulator.
        steps: how many it was given.
        missed: how many of them it has not answered.
    """

    watch: Watch
    steps = missed = 0

    def __init__(self, setup: Px4Setup, build: Path, world: World, hand: Watch | None) -> None:
        self._build, self._folder, self._instance = build, setup.folder, setup.instance
        self._starts = 0
        self.system = setup.instance + 1
        url = f"udpin://127.0.0.1:{ONBOARD_PORT + setup.instance}"
        self.link = open_link(LinkParams(url, self.system), None, time.time_ns)
        port = PX4_PORT + setup.instance
        begin = partial(HilFlight, world, setup.seed, False, self._watch, hand)
        self._hil = HilSimulator(begin, port, speed=0.0)
        self._parameters = {**airframe_parameters(world, setup.seed), **MOCAP_ONLY}

    def _watch(self, simulator: Simulator) -> None:
        self.watch(simulator)

    @property
    def armed(self) -> bool:
        """Its rotors may turn."""
        return self._hil.motors.armed

    def fly(self, over: Callable[[], bool]) -> None:
        """Start PX4, in a folder of its own and with its vehicle on the ground; fly until `over`.

        Raises:
            InputError: PX4 does not start, has ended, or does not answer.
        """
        again = f"-again-{self._starts}" if self._starts else ""
        folder = self._folder.with_name(self._folder.name + again)
        self._starts += 1
        with Px4Process(self._build, folder, self._parameters, self._instance) as px4:
            stepped_s = time.monotonic()
            while not over():
                now_ns = time.monotonic_ns()
                if self._hil.advance(now_ns):
                    stepped_s = time.monotonic()
                    self.steps, self.missed = self._hil.steps, self._hil.missed
                elif not px4.running or time.monotonic() - stepped_s > _SILENT_S:
                    raise InputError("PX4 has ended or does not answer; accepted: one that flies")
                else:
                    self._hil.wait(now_ns, _WAIT_S)

    def close(self) -> None:
        """Close the links."""
        self.link.close()
        self._hil.close()


class _MemoryLink:
    """One end of a MAVLink link within the process: as much of `Link` as is used, no socket."""

    def __init__(self, system: int, component: int) -> None:
        self.mav = Codec(system, component)
        self.now_ns = EPOCH_NS
        """Time that arrivals are stamped with; the owner sets it."""
        self.other: _MemoryLink = self
        """The other end."""
        self._came: deque[Received] = deque()

    def send(self, message: Any, to: Any = None) -> bool:
        """Send a message; it is there at once."""
        self.other.arrive(bytes(message.pack(self.mav)))
        self.mav.seq = (self.mav.seq + 1) % 256
        return True

    def arrive(self, data: bytes) -> None:
        """Take the bytes of one message."""
        for message in self.mav.feed(data, whole=True):
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self._came.append(Received(message, self.now_ns, *sender, None))

    def receive(self, limit: int = 200) -> list[Received]:
        """Return the messages that have come."""
        return [self._came.popleft() for _ in range(min(limit, len(self._came)))]


class SimulatedPx4:
    """The simulated PX4 and its vehicle: no socket, no clock, no chance but seeds.

    Attributes are those of `RealPx4`.
    """

    watch: Watch
    system, steps, missed = 1, 0, 0

    def __init__(self, world: World, seed: int, hand: Watch | None) -> None:
        self._world, self._seed, self._hand = world, seed, hand
        own = LinkParams()
        self.link = _MemoryLink(own.own_system, own.own_component)
        self._link = _MemoryLink(1, 1)
        self.link.other, self._link.other = self._link, self.link
        self._boot()

    def _boot(self) -> None:
        """Set the vehicle on the ground, disarmed."""
        table = ParameterTable()
        for name, value in {**MOCAP_ONLY, **SAFE_PARAMETERS}.items():
            table.store(name, value)
        self._vehicle = Px4Vehicle(self._world, self._seed, table)
        self._vehicle.hand = self._hand
        self._endpoint = Endpoint(self._vehicle, [(self._link, "onboard")])  # type: ignore[list-item]

    @property
    def armed(self) -> bool:
        """Its rotors may turn."""
        return self._vehicle.armed

    def fly(self, over: Callable[[], bool]) -> None:
        """Fly until `over`; a second flight begins on the ground again."""
        if self._vehicle.tick:
            self._boot()
        epoch_ns = self.link.now_ns
        while not over():
            boot_ns = (self._vehicle.tick + 1) * TICK_NS
            self.link.now_ns = self._link.now_ns = epoch_ns + boot_ns
            self._endpoint.advance(boot_ns, epoch_ns + boot_ns)
            self.steps = self._vehicle.tick
            self.watch(self._vehicle.simulator)


LockstepPx4 = RealPx4 | SimulatedPx4
"""A PX4 that flies a vehicle of this process."""
