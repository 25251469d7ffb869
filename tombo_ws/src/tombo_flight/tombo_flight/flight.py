"""The headless flight: the cores of the wiring and the vehicle in one compiled loop, no server.

Deterministic in (scenario, seed). Compiled code flies until a collision is to be reacted to; the
reaction decides here, whichever it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tombo_bag.flight import Flight, Series, Topic
from tombo_bag.flight_topics import flown_topics
from tombo_bag.topics import COLLISION_EVENT, CONTACT_EVENT, MISSION_STATUS, REACTION_STATUS
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Output, no_texts
from tombo_dynamics.effects.downwash import jet_of, set_jets
from tombo_dynamics.errors import InputError
from tombo_dynamics.message_records import record_of
from tombo_dynamics.plant import Plant
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_flight.flight_metrics import phase_event, with_figures
from tombo_flight.scenario import Scenario, as_mapping, world_of
from tombo_flight.several_vehicles import FlownVehicle
from tombo_flight.wiring import core_of
from tombo_sim.flight_loop import (
    MISSION,
    REACTION,
    TABLES,
    fly,
    new_published,
    one_flight,
    published_by,
    shared_by,
    step_in_python,
)
from tombo_sim.flight_setup import NOISE, FlightSetup, begin, capture_ticks
from tombo_sim.kernel import FIGURE_COLUMNS, Flights, Log, new_log, part_of
from tombo_sim.normals import draw_normals, stream_of
from tombo_sim.sensing import in_order_of_arrival
from tombo_sim.wiring import CORES, POSE

_FIRST = (
    "/odometry",
    "/estimator/status",
    "/detector/status",
    "/collision_event",
    "/reaction/status",
    "/setpoint",
    "/mission/setpoint",
    "/contact_event",
    "/mission/status",
)
"""The order of topics in a recording begins with these."""
_OF_FIGURES = (COLLISION_EVENT.name, CONTACT_EVENT.name, REACTION_STATUS.name)
"""Topics that figures are made of."""
_POSES = list(TABLES).index(POSE)
_BLOCK = 2048
"""Ticks between two drawings of random numbers, and two looks at `stop`."""


@dataclass
class Workspace:
    """Memory of flights, reused from one to the next: fresh pages cost milliseconds."""

    figures_only: bool = False
    """Flights keep what their summary is made of: `FIGURE_COLUMNS` of their log, few topics, no
    scenario."""
    log: Any = field(default_factory=lambda: new_log(0))
    published: tuple[Any, ...] = field(default_factory=lambda: new_published(1, 0))
    _ticks: int = 0

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the log that flights keep."""
        return FIGURE_COLUMNS if self.figures_only else Log._fields

    def for_flight(self, ticks: int) -> tuple[Any, tuple[Any, ...]]:
        """Return a log and tables of messages; their content is what the last flight left."""
        if self._ticks < ticks:
            self.log, self.published = new_log(ticks, self.columns), new_published(1, ticks)
            self._ticks = ticks
        return part_of(self.log, slice(ticks)), self.published


def fly_scenario(
    scenario: Scenario,
    seed: int,
    workspace: Workspace | None = None,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    prepare: Callable[[Plant], None] | None = None,
) -> Flight:
    """Fly a scenario and return the flight.

    Args:
        scenario: what to fly.
        seed: all randomness derives from it.
        workspace: memory to reuse; the record's arrays then live in it until the next flight.
        progress: called with the flight time [s] now and then.
        stop: asked now and then; True ends the flight where it is.
        prepare: called with the plant before the first tick, to change what a scenario
            cannot say.

    Raises:
        InputError: the propeller cannot lift the vehicle; the vehicle would start inside the
        obstacle; stiff parameters make the simulation diverge; or the reaction fails, or its
        decision can't be flown.
    """
    setup = begin(world_of(scenario), seed)
    if prepare is not None:
        prepare(setup.plant)
    ticks = round(scenario.duration / TICK_S)
    memory = workspace or Workspace()
    log, published = memory.for_flight(ticks)
    running = _Running(scenario, setup, log, published)
    began = time.perf_counter()
    running.fly(ticks, progress, stop)
    wall = time.perf_counter() - began
    return running.result(seed, memory.columns, wall, figures_only=memory.figures_only)


def fly_several(vehicles: Sequence[FlownVehicle]) -> dict[str, Flight]:
    """Fly several vehicles of one room in lockstep; return the flight of each by its name.

    In each tick a vehicle feels the jets of the others, and its mission knows their poses, as of
    the tick before.

    Raises:
        InputError: as `fly_scenario`.
    """
    running: list[_Running] = []
    for vehicle in vehicles:
        scenario, ticks = vehicle.scenario, round(vehicle.scenario.duration / TICK_S)
        setup = begin(replace(world_of(scenario), start=vehicle.start), vehicle.seed)
        flight = _Running(scenario, setup, new_log(ticks), new_published(1, ticks))
        flight.progress.end = ticks
        flight.cores[MISSION].expect_others(len(vehicles) - 1)
        running.append(flight)
    company = [(one, [other for other in running if other is not one]) for one in running]
    seen = [0] * len(running)
    began = time.perf_counter()
    tick = 0
    while not all(flight.over for flight in running):
        for one, others in company if tick else ():
            set_jets(one.plant, [jet_of(other.plant.start, other.plant) for other in others])
        tick += 1
        for one in running:
            if not one.over:
                one.fly_on(tick)
        for i, one in enumerate(running):
            if (count := int(one.flights.counts[0, _POSES])) > seen[i]:
                seen[i] = count
                place = one.flights.published[_POSES][0, count - 1]["message"]["position"]
                for k, other in enumerate(running):
                    if other is not one:
                        other.cores[MISSION].see_other(i - (i > k), place)
    wall = time.perf_counter() - began
    return {
        vehicle.name: flight.result(vehicle.seed, Log._fields, wall)
        for vehicle, flight in zip(vehicles, running, strict=True)
    }


class _Running:
    """A flight of which some ticks are flown."""

    def __init__(
        self, scenario: Scenario, setup: FlightSetup, log: Any, published: tuple[Any, ...]
    ) -> None:
        self._scenario, self._setup = scenario, setup
        rate = setup.mocap_rate
        captures = np.append(capture_ticks(scenario.duration, rate), np.int64(2**62))
        self.cores: list[Any] = [core_of(kind, scenario) for kind in CORES]
        self._reaction: Any = self.cores[REACTION]
        normals = np.empty((captures.size, NOISE))
        flights = one_flight(setup.plant, setup.theta, (captures, normals), self.cores, published)
        self.flights = flights._replace(noise=np.empty((1, _BLOCK, NOISE)))
        self._shared = shared_by(setup.maps, self.cores, log)
        self.plant = setup.plant
        self._state = setup.plant.state
        self.progress = self.flights.progress[0]
        self.progress.over.ground = scenario.vehicle.leg_height
        normals = self.flights.mocap_noise[0]
        normals[:] = setup.mocap_noise.standard_normal(normals.shape)
        self._stream = stream_of(setup.tick_noise)
        self._drawn = 0

    def fly(
        self,
        end: int,
        progress: Callable[[float], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        """Fly to tick `end`, or until `stop`.

        Raises:
            InputError: as `fly_scenario`.
        """
        flight = self.progress
        flight.end = end
        while not self.over:
            self.fly_on(end)
            now_s = float(flight["tick"]) * TICK_S
            if stop is not None and stop():
                break
            if progress is not None:
                progress(now_s)

    @property
    def over(self) -> bool:
        """Whether the end has come: that of a flight that is over is earlier than asked for."""
        return int(self.progress.tick) >= int(self.progress.end)

    def fly_on(self, stop: int) -> None:
        """Fly to tick `stop`, the end, or the end of the random numbers or of a decision.

        Raises:
            InputError: as `fly_scenario`.
        """
        flights, flight = self.flights, self.progress
        k = int(flight.tick)
        if k == self._drawn:
            flights.base[0], self._drawn = k, k + _BLOCK
            draw_normals(self._stream, flights.noise[0])
        if fly(flights, self._shared, 0, min(self._drawn, stop)):
            step_in_python(flights, 0, self._reaction)
            if self._reaction.failure:
                raise InputError(self._reaction.failure)
        now_s = float(flight["tick"]) * TICK_S
        if not math.isfinite(self._state.position[2] + self._state.rates[0]):
            raise InputError(
                f"the simulation diverges at {now_s:.2f} s: vehicle and effects together are "
                "too stiff for steps of 1 ms; accepted: larger inertia, or smaller stiffness "
                "and damping"
            )

    def result(
        self, seed: int, columns: Iterable[str], wall: float, *, figures_only: bool = False
    ) -> Flight:
        """Return the flight as far as it is flown, with some columns of its log."""
        ticks, scenario = int(self.progress["tick"]), self._scenario
        rows = part_of(self._shared.log, slice(ticks))._asdict()
        kept = {name: rows[name] for name in columns}
        t: Array = np.arange(ticks, dtype=np.float64) * TICK_S
        flight = Flight({}, name=scenario.name, t=t, log=kept, epoch_ns=EPOCH_NS)
        said = published_by(self.flights, 0)
        if figures_only:
            flight = replace(flight, topics=_topics(said, _OF_FIGURES))
        else:
            topics = _topics(said, dict.fromkeys((*_FIRST, *said)))
            topics = flown_topics(t, kept, _poses(self.flights), topics)
            flight = replace(flight, topics=topics, scenario=as_flown(scenario, seed, self._setup))
        return with_figures(flight, scenario, seed, wall, _phases(said))


def as_flown(scenario: Scenario, seed: int, setup: FlightSetup) -> dict[str, Any]:
    """Return the scenario as plain values, with the seed and the values that follow from it."""
    flown = as_mapping(scenario)
    flown["effects"] = setup.effects
    flown["estimator"] = {**flown["estimator"], "mocap_rate": setup.mocap_rate}
    flown["seed"] = seed
    flown["obstacle"] = dict(zip(("x_m", "y_m", "radius_m", "top_m"), setup.obstacle, strict=True))
    return flown


def _poses(flights: Flights) -> Topic:
    """Return the poses of the motion capture, in order of arrival."""
    entries = flights.entries[0]
    poses = entries[in_order_of_arrival(entries)]
    fields = {name: poses[name] for name in ("position", "attitude")}
    return Topic.of(poses["stamp"] * TICK_S, fields, poses["arrives"] * TICK_S)


def _topics(published: dict[str, Any], names: Iterable[str]) -> dict[str, Topic]:
    """Return the topics that the cores have published."""
    return {name: _topic(published[name], TABLES[name]) for name in names}


def _topic(table: Any, output: Output) -> Topic:
    """Return a table of messages: views of its numbers, and texts."""
    ticks, messages = table["tick"], table["message"]
    said = ticks * TICK_S
    stamps = messages["stamp_ns"] - EPOCH_NS
    captured = np.where(stamps == ticks * TICK_NS, said, stamps * 1e-9)
    names = record_of(output.kind).fields
    topic = Topic.of(captured, {name: messages[name] for name in names}, said)
    if output.texts is not no_texts:
        text = np.array([output.texts(message)["text"] for message in messages], np.str_)
        topic["text"] = Series(topic.t, text, topic.arrival)
    return topic


def _phases(published: dict[str, Any]) -> list[dict[str, Any]]:
    """Return an event for each phase that the mission has begun in flight."""
    status = published[MISSION_STATUS.name]
    phase = status["message"]["phase"]
    begun = np.flatnonzero(np.diff(phase, prepend=0) != 0)
    return [phase_event(float(status["tick"][i]) * TICK_S, phase[i]) for i in begun]
