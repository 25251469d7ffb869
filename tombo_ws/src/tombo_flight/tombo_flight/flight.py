"""The headless flight: the cores of the wiring and the vehicle in one compiled loop, no server.

Deterministic in (scenario, seed). Compiled code flies until a collision is to be reacted to; the
reaction decides here, whichever it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tombo_bag.flight import Flight, Series, Topic
from tombo_bag.flight_topics import FlownTopics
from tombo_bag.topics import MISSION_STATUS
from tombo_collision.reaction_core import ReactionCore
from tombo_control.mission_core import status_text
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import Core
from tombo_dynamics.errors import InputError
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.message_records import message_of
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import as_arrays
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_flight.flight_metrics import phase_event, with_figures
from tombo_flight.scenario import Scenario, as_mapping, world_of
from tombo_flight.wiring import CORES, core_of
from tombo_sim.flight_setup import NOISE, FlightSetup, begin, capture_ticks
from tombo_sim.kernel import (
    CONTACT,
    EVENT,
    FlightProgress,
    Published,
    core_memories,
    fly_from_python,
    new_published,
    publish_reaction,
)
from tombo_sim.log_columns import new_log, part_of
from tombo_sim.sensing import Captures, MocapEntry

_TOPICS = {
    "odometry": "/odometry",
    "estimator_status": "/estimator/status",
    "detector_status": "/detector/status",
    "event": "/collision_event",
    "reaction_status": "/reaction/status",
    "setpoint": "/setpoint",
    "mission_setpoint": "/mission/setpoint",
    "contact": "/contact_event",
}
"""Tables of `Published` → topics; `/mission/status` has a text besides."""
_BLOCK = 8192
_CHUNK = 2048
"""Ticks between two looks at `stop`."""


@dataclass
class Workspace:
    """Memory of flights, reused from one to the next: fresh pages cost milliseconds."""

    log: Any = field(default_factory=lambda: new_log(0))
    published: Published = field(default_factory=lambda: new_published(0, 0))
    _size: tuple[int, int] = (0, 0)

    def for_flight(self, ticks: int, captures: int) -> tuple[Any, Published]:
        """Return a log and tables of messages; their content is what the last flight left."""
        if self._size < (ticks, captures):
            self.log, self.published = new_log(ticks), new_published(ticks, captures)
            self._size = (ticks, captures)
        return part_of(self.log, ticks), self.published


def fly_scenario(
    scenario: Scenario,
    seed: int,
    workspace: Workspace | None = None,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    prepare: Callable[[Plant], None] | None = None,
    finish: Callable[[Sequence[Core]], None] | None = None,
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
        finish: called with the cores after the last tick, to see what a record does not have.

    Raises:
        InputError: the propeller cannot lift the vehicle, the vehicle would start inside the
            obstacle, parameters are so stiff that the simulation diverges, or the reaction fails
            or decides what can't be flown.
    """
    setup = begin(world_of(scenario), seed)
    if prepare is not None:
        prepare(setup.plant)
    ticks = round(scenario.duration / TICK_S)
    captures = np.append(capture_ticks(scenario.duration, setup.mocap_rate), np.int64(2**62))
    entries = np.zeros(captures.size, MocapEntry.layout)
    normals = setup.mocap_noise.standard_normal((captures.size, NOISE))
    poses = as_arrays((captures, normals, entries, Captures.new()))
    log, published = (workspace or Workspace()).for_flight(ticks, captures.size)
    cores: Any = [core_of(kind, scenario) for kind in CORES]
    reaction: ReactionCore = cores[CORES.index(ReactionCore)]
    memories, params = as_arrays(core_memories(*cores))
    flight = FlightProgress.new()
    flight["end"] = ticks
    flight["over"]["ground"] = scenario.vehicle.leg_height

    began = time.perf_counter()
    noise: Array = np.empty((0, NOISE))
    base = 0
    while (k := int(flight["tick"])) < flight["end"]:
        if k >= base + noise.shape[0]:
            base = k
            noise = setup.tick_noise.standard_normal((_BLOCK, NOISE))
        vehicle = as_arrays((setup.plant, setup.maps, setup.theta, noise))
        until = min(base + _BLOCK, k + _CHUNK)
        if fly_from_python(
            vehicle, poses, memories, params, published, flight.as_array(), log, base, until
        ):
            _react(reaction, published, flight)
        now_s = float(flight["tick"]) * TICK_S
        state = setup.plant.state
        if not math.isfinite(state.position[2] + state.rates[0]):
            raise InputError(
                f"the simulation diverges at {now_s:.2f} s: vehicle and effects together are "
                "too stiff for steps of 1 ms; accepted: larger inertia, or smaller stiffness and "
                "damping"
            )
        if stop is not None and stop():
            break
        if progress is not None:
            progress(now_s)
    wall = time.perf_counter() - began
    if finish is not None:
        finish(cores)

    said = {
        name: table[: flight["published"][i]]
        for i, (name, table) in enumerate(zip(Published._fields, published, strict=True))
    }
    flown = as_flown(scenario, seed, setup)
    return _record(scenario, seed, flown, part_of(log, flight["tick"]), entries, said, wall)


def _react(reaction: ReactionCore, published: Published, flight: Any) -> None:
    """Step the reaction in the last tick, which a collision has reached.

    Raises:
        InputError: the reaction has failed, or decided what can't be flown.
    """
    tick = int(flight["tick"]) - 1
    hand_collisions(reaction, published, flight["published"], tick)
    reaction.step(EPOCH_NS + tick * TICK_NS)
    if reaction.failure:
        raise InputError(reaction.failure)
    publish_reaction(reaction.memory, published, flight, tick)


def hand_collisions(reaction: ReactionCore, published: Published, counts: Any, tick: int) -> None:
    """Hand the reaction the collisions that were published in the tick before `tick`."""
    now_ns = EPOCH_NS + tick * TICK_NS
    for topic, table, index in (
        ("/collision_event", published.event, EVENT),
        ("/contact_event", published.contact, CONTACT),
    ):
        events = table[: counts[index]]
        for entry in events[events["tick"] == tick - 1]:
            event = message_of(CollisionEvent, entry["message"], frame_id=FRAME_MAP)
            reaction.on(topic, event, now_ns)


def as_flown(scenario: Scenario, seed: int, setup: FlightSetup) -> dict[str, Any]:
    """Return the scenario as plain values, with the seed and what follows from it."""
    flown = as_mapping(scenario)
    flown["effects"] = setup.effects
    flown["estimator"]["mocap_rate"] = setup.mocap_rate
    flown["seed"] = seed
    flown["obstacle"] = dict(zip(("x_m", "y_m", "radius_m", "top_m"), setup.obstacle, strict=True))
    return flown


def _record(
    scenario: Scenario,
    seed: int,
    flown: dict[str, Any],
    log: Any,
    entries: Any,
    published: dict[str, Any],
    wall: float,
) -> Flight:
    t: Array = np.arange(log.position.shape[0], dtype=np.float64) * TICK_S
    columns = log._asdict()
    poses = entries[published["detector_status"]["row"]]
    fields = {name: poses[name] for name in ("position", "attitude")}
    mocap = Topic.of(poses["stamp"] * TICK_S, fields, poses["arrives"] * TICK_S)
    flight = Flight(
        FlownTopics(t, columns, mocap, _by_topic(published)),
        name=scenario.name,
        t=t,
        log=columns,
        scenario=flown,
        epoch_ns=EPOCH_NS,
    )
    return with_figures(flight, scenario, seed, wall, _phases(published))


def _by_topic(published: dict[str, Any]) -> dict[str, Topic]:
    """Return what the cores have published."""
    topics = {
        topic: _topic(published[name], published[name]["message"].dtype.names)
        for name, topic in _TOPICS.items()
    }
    status = published["mission_status"]
    reasons = zip(status["message"]["phase"], status["wait_reason"], strict=True)
    text = np.array([status_text(int(phase), int(why)) for phase, why in reasons], np.str_)
    topic = _topic(status, status["message"].dtype.names)
    topic["text"] = Series(topic.t, text, topic.arrival)
    return {**topics, MISSION_STATUS.name: topic}


def _topic(table: Any, names: Sequence[str]) -> Topic:
    """Return a table of `Published`: views of its messages."""
    ticks, messages = table["tick"], table["message"]
    said = ticks * TICK_S
    stamps = messages["stamp_ns"] - EPOCH_NS
    captured = np.where(stamps == ticks * TICK_NS, said, stamps * 1e-9)
    return Topic.of(captured, {name: messages[name] for name in names}, said)


def _phases(published: dict[str, Any]) -> list[dict[str, Any]]:
    """Return an event for each phase that the mission has begun in flight."""
    status = published["mission_status"]
    phase = status["message"]["phase"]
    begun = np.flatnonzero(np.diff(phase, prepend=0) != 0)
    return [phase_event(float(status["tick"][i]) * TICK_S, phase[i]) for i in begun]
