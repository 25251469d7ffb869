"""The headless flight: plant, autopilot, detector, reaction and mission in lockstep, no server.

Deterministic in (scenario, seed). Compiled code flies from one mocap sample to the next; detector,
reaction and mission look at each sample as their nodes would.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector import CollisionDetector, CollisionEvent
from tombo_collision.reaction import ReactionState, react
from tombo_control import mission as plan
from tombo_control.autopilot import (
    LAND,
    LANDED,
    PHASE_NAMES,
    A,
    new_autopilot,
)
from tombo_dynamics.errors import InputError
from tombo_dynamics.plant import P, part
from tombo_sim.flight_end import FlightEndDetector
from tombo_flight.flight_metrics import MetricsInput, summarize
from tombo_flight.flight_record import FlightRecord
from tombo_flight.scenario import Scenario, as_mapping, world_of
from tombo_sim.flight_setup import NOISE, TICK_S, FlightSetup, begin
from tombo_sim.kernel import ARRIVES, MOCAP_WIDTH, POSE, STAMPED, fly
from tombo_sim.log_columns import COLUMNS, LOG_WIDTH

Array = NDArray[np.float64]

_BLOCK = 8192


@dataclass
class Workspace:
    """Scratch memory for flights, reused from one to the next: fresh pages cost milliseconds."""

    log: Array = field(default_factory=lambda: np.zeros((0, LOG_WIDTH)))

    def rows(self, count: int) -> Array:
        """Return a log of `count` rows; its content is what the last flight left."""
        if self.log.shape[0] < count:
            self.log = np.full((count, LOG_WIDTH), math.nan)
        view: Array = self.log[:count]
        return view


@dataclass
class _FlightState:
    """What detector, reaction and mission have come to in the flight so far."""

    mission: plan.MissionState
    detector: CollisionDetector
    reaction: ReactionState = field(default_factory=ReactionState)
    events: list[dict[str, Any]] = field(default_factory=list)
    detections: list[CollisionEvent] = field(default_factory=list)
    arrivals: list[float] = field(default_factory=list)
    reactions: list[ReactionState] = field(default_factory=list)
    statistics: list[tuple[int, float]] = field(default_factory=list)
    modes: list[tuple[float, int]] = field(default_factory=list)


def fly_scenario(
    scenario: Scenario,
    seed: int,
    workspace: Workspace | None = None,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], bool] | None = None,
    prepare: Callable[[Array], None] | None = None,
) -> FlightRecord:
    """Fly a scenario and return its record.

    Args:
        scenario: what to fly.
        seed: all randomness derives from it.
        workspace: memory to reuse; the record's log then lives in it until the next flight.
        progress: called with the flight time [s] now and then.
        stop: asked at each sample; True ends the flight where it is.
        prepare: called with the plant's memory before the first tick, to change what a scenario
            cannot say.

    Raises:
        InputError: the propeller cannot lift the vehicle, the vehicle would start inside the
            obstacle, or parameters are so stiff that the simulation diverges.
    """
    vehicle = scenario.vehicle
    setup = begin(world_of(scenario), seed)
    m, maps, theta = setup.m, setup.maps, setup.theta
    if prepare is not None:
        prepare(m)
    ticks = round(scenario.duration / TICK_S)
    captures = np.round(
        np.arange(0.0, scenario.duration, 1.0 / scenario.estimator.mocap_rate) / TICK_S
    ).astype(np.int64)
    captures = np.append(captures, np.int64(2**62))
    mocap_noise = setup.mocap_noise.standard_normal((captures.size, NOISE))
    mocap = np.zeros((captures.size, MOCAP_WIDTH))
    log = (workspace or Workspace()).rows(ticks)
    body = part(m, "body")
    a = new_autopilot(scenario.control, scenario.estimator, vehicle, body[:3], body[6:10])

    course = _FlightState(plan.begin(setup.start), CollisionDetector(scenario.detector))
    flight_end = FlightEndDetector(vehicle.leg_height)
    state = np.zeros(3, dtype=np.int64)
    began = time.perf_counter()
    k = 0
    end = ticks
    noise: Array = np.empty((0, NOISE))
    base = 0
    while k < end:
        if k >= base + noise.shape[0]:
            base = k
            noise = setup.tick_noise.standard_normal((_BLOCK, NOISE))
        k, row = fly(
            m,
            a,
            maps,
            theta,
            noise,
            mocap_noise,
            captures,
            mocap,
            state,
            log,
            base,
            k,
            min(end, base + noise.shape[0]),
        )
        if not math.isfinite(m[P.body + 2] + m[P.body + 10]):
            raise InputError(
                f"the simulation diverges at {k * TICK_S:.2f} s: vehicle and effects together are "
                "too stiff for steps of 1 ms; accepted: larger inertia, or smaller stiffness and "
                "damping"
            )
        if row < 0:
            continue
        now = k * TICK_S
        _process_pose(course, scenario, mocap[row], row, now, a)
        upright = 1.0 - 2.0 * (m[P.body + 6] ** 2 + m[P.body + 7] ** 2)
        finished = flight_end.watch(m[P.body + 2], upright, course.mission.mode)
        if finished is not None:
            end = min(end, k + round(finished / TICK_S))
        if stop is not None and stop():
            break
        if progress is not None and row % 64 == 0:
            progress(now)
    wall = time.perf_counter() - began

    flown = as_flown(scenario, seed, setup)
    return _record(scenario, seed, flown, log[:k], mocap, course, wall)


def as_flown(scenario: Scenario, seed: int, setup: FlightSetup) -> dict[str, Any]:
    """Return the scenario as plain values, with the seed and what follows from it."""
    flown = as_mapping(scenario)
    flown["effects"] = setup.effects
    flown["seed"] = seed
    flown["obstacle"] = dict(zip(("x_m", "y_m", "radius_m", "top_m"), setup.obstacle, strict=True))
    return flown


def _process_pose(
    course: _FlightState, scenario: Scenario, sample: Array, row: int, now: float, a: Array
) -> None:
    """Hand a delivered pose to detector, reaction and mission, their outcome to the autopilot."""
    stamp = sample[STAMPED] * TICK_S
    event, statistic = None, 0.0
    if stamp <= now:  # the detector's node refuses a stamp from the future
        event = course.detector.update(stamp, sample[POSE : POSE + 3], sample[POSE + 3 : POSE + 7])
        statistic = course.detector.statistic
    course.statistics.append((row, statistic))
    before = course.mission
    if event is not None:
        course.detections.append(event)
        course.arrivals.append(now)
        course.events.append(
            {
                "time_s": now,
                "kind": "detection",
                "text": f"collision detected ({event.trigger})",
                "trigger": event.trigger,
                "stamp_s": event.stamp_s,
                "contact_time_s": event.contact_time_s,
                "x_c_m": event.x_c.tolist(),
                "flight_direction": event.flight_direction.tolist(),
                "confidence": event.confidence,
                "statistic": event.statistic,
                "count": event.count,
            }
        )
        if scenario.react and before.mode not in (LAND, LANDED):
            course.reaction = react(course.reaction, event, scenario.reaction)
            course.reactions.append(course.reaction)
            course.mission = plan.start_reaction(before, course.reaction.x_r, now)
            course.events.append(
                {
                    "time_s": now,
                    "kind": "setpoint_switch",
                    "text": "set point moved to x_r",
                    "x_c_m": event.x_c.tolist(),
                    "x_r_m": course.reaction.x_r.tolist(),
                    "n_r": course.reaction.n_r.tolist(),
                    "count": course.reaction.collisions,
                }
            )
    course.mission = plan.advance_mission(
        course.mission,
        scenario.mission,
        now,
        a[A.position : A.position + 3],
        a[A.velocity : A.velocity + 3],
    )
    if course.mission is not before:
        if course.mission.leg is not before.leg:
            a[A.leg : A.leg + 14] = course.mission.leg.as_array()
        if course.mission.mode != before.mode:
            a[A.mode] = course.mission.mode
            course.modes.append((now, course.mission.mode))


def _record(
    scenario: Scenario,
    seed: int,
    flown: dict[str, Any],
    log: Array,
    mocap: Array,
    course: _FlightState,
    wall: float,
) -> FlightRecord:
    columns = {name: log[:, where] for name, where in COLUMNS.items()}
    rows = np.array([row for row, _ in course.statistics], dtype=np.int64)
    events = course.events + [
        {"time_s": when, "kind": PHASE_NAMES[mode], "text": PHASE_NAMES[mode].replace("_", " ")}
        for when, mode in course.modes
    ]
    t: Array = np.arange(log.shape[0], dtype=np.float64) * TICK_S
    summary, seen = summarize(
        MetricsInput(
            scenario, seed, t, columns, course.detections, course.arrivals, course.reactions, wall
        )
    )
    events = sorted(events + seen, key=lambda e: float(e["time_s"]))
    arrived = mocap[rows]
    return FlightRecord(
        t=t,
        log=columns,
        mocap_t=arrived[:, STAMPED] * TICK_S,
        mocap_arrival=arrived[:, ARRIVES] * TICK_S,
        mocap_position=arrived[:, POSE : POSE + 3],
        mocap_attitude=arrived[:, POSE + 3 : POSE + 7],
        detector_statistic=np.array([value for _, value in course.statistics]),
        events=events,
        scenario=flown,
        summary=summary,
    )
