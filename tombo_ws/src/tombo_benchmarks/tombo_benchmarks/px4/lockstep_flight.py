"""One flight with a PX4 in lockstep: physics, mission, detector, reaction and bridge here.

Time is the simulation's, also for the bridge and for TIMESYNC, so that a flight does not depend on
the load of the machine. A real PX4 shares only the sockets; without one the simulated PX4 flies.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from tombo_bag.flight import Flight
from tombo_benchmarks.px4.lockstep_px4 import LockstepPx4, Px4Setup
from tombo_collision.decision import Decision
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CoreRunner
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.messages import (
    CollisionEvent,
    MissionStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    ReactionStatus,
)
from tombo_dynamics.rotation import conjugate, rotate_vector
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_flight.flight_metrics import detection_of, summarize
from tombo_flight.scenario import Scenario, world_of
from tombo_flight.wiring import core_of
from tombo_px4.bridge.bridge import Bridge
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams, LinkParams
from tombo_px4.bridge.session import BridgeOutput, SessionStage
from tombo_px4.hil.hand_motion import HandMotion
from tombo_px4.link.mavlink_link import Received
from tombo_sim.ground_truth import FlightEndDetector, contact_force
from tombo_sim.kernel import FIGURE_COLUMNS
from tombo_sim.simulator import Simulator
from tombo_sim.wiring import CORES, PX4_REPLACES

_BRIDGE_TICKS = 4
"""The bridge runs at 250 Hz."""
_READY_S = 60.0
"""Simulated time in which PX4 must be ready to fly."""
_DISARM_S = 6.0
"""PX4 disarms 2 s after it has landed."""
_AFTER_HAND_S = 16.0
"""Time at rest after the hand; axes that are not proven by then stay unproven."""
_MISTAKE_S = 3.0
"""Time after the hand for the report of a mistake."""
_AFTER_DISARM_S = 1.0
_FARTHEST_M = 30.0
"""A vehicle further away than this has flown away."""

AsMocap = Callable[[Array, Array], tuple[Array, Array]]
"""Makes of position (3) and attitude (4) what a wrong motion capture sends of them."""


LockstepFlight = tuple[dict[str, Any], dict[str, Array]]
"""The figures of `summary.json` with those of PX4; and name to (N, k), per tick of 1 ms from the
mission's first word, empty if it has never armed."""


def fly_lockstep(
    setup: Px4Setup,
    scenario: Scenario,
    *,
    bridge: BridgeParams | None = None,
    as_mocap: AsMocap | None = None,
    hand: HandMotion | None = None,
) -> LockstepFlight:
    """Fly a scenario once, by motion capture alone.

    Args:
        setup: the PX4 that flies.
        scenario: what to fly.
        bridge: parameters of the bridge; None: as for a simulated motion capture, whose axes need
            no proof.
        as_mocap: the pose that the motion capture sends in place of the true one.
        hand: carries and turns the vehicle before the flight.

    Raises:
        InputError: PX4 does not start, or stops answering.
    """
    with setup.start(world_of(scenario), hand) as px4:
        flight = LockstepRun(px4, scenario, setup.seed, bridge, as_mocap=as_mocap, hand=hand)
        flight.fly()
    return flight.result()


def _as_it_is(position: Array, attitude: Array) -> tuple[Array, Array]:
    return position, attitude


class LockstepRun:
    """The running flight."""

    def __init__(
        self,
        px4: LockstepPx4,
        scenario: Scenario,
        seed: int,
        bridge: BridgeParams | None = None,
        *,
        as_mocap: AsMocap | None = None,
        hand: HandMotion | None = None,
    ) -> None:
        self._px4, self._scenario, self._seed = px4, scenario, seed
        px4.watch = self._tick
        self._as_mocap = as_mocap or _as_it_is
        self._ready_s = _READY_S if hand is None else hand.end_s + _AFTER_HAND_S
        self._epoch_ns = EPOCH_NS
        self._simulator: Simulator | None = None
        link = replace(LinkParams(), system=px4.system)
        params = bridge or BridgeParams(axes_evidence=SIMULATED)
        self._bridge = Bridge(params, link, scenario.vehicle.mass)
        kinds = [kind for kind in CORES if kind not in PX4_REPLACES]
        self._runners = [CoreRunner(core_of(kind, scenario)) for kind in kinds]
        self._end = FlightEndDetector(scenario.vehicle.leg_height)
        self._end_s = scenario.duration
        self._over_s: float | None = None
        self._began_ns: int | None = None
        self._now_ns = EPOCH_NS
        self._phase = int(Phase.IDLE)
        self._setpoint: Array = np.full(3, math.nan)
        self._followed_phase = int(Phase.IDLE)
        self._rows: list[tuple[Any, ...]] = []
        self._estimates: list[tuple[int, Array]] = []
        self._texts: list[tuple[int, str]] = []
        self._notes: list[tuple[int, str]] = []
        self._decisions: list[Decision] = []
        self._detections: list[tuple[int, CollisionEvent]] = []
        self._armed_once = False
        self._disarmed_s: float | None = None
        self._status_why = ""
        self._wall_s = 0.0

    @property
    def _flown_s(self) -> float:
        return 0.0 if self._began_ns is None else (self._now_ns - self._began_ns) * 1e-9

    @property
    def _over(self) -> bool:
        """The flight has ended and the vehicle is disarmed, or `_DISARM_S` have passed since.

        A flight that has not begun is over when PX4 was not ready within its time.
        """
        if self._began_ns is None:
            verdict, now_s = (self._bridge.checklist.verdict, (self._now_ns - EPOCH_NS) * 1e-9)
            known = verdict is not None and bool(verdict.mistake) and verdict.sure
            return now_s > self._ready_s - (_AFTER_HAND_S - _MISTAKE_S if known else 0.0)
        if self._flown_s < self._end_s:
            return False
        self._over_s = self._flown_s if self._over_s is None else self._over_s
        return not self._px4.armed or self._flown_s - self._over_s > _DISARM_S

    def fly(self) -> None:
        """Fly until the vehicle has landed and is disarmed, or the time for that has passed.

        The wall time that it takes goes to the summary.

        Raises:
            InputError: PX4 does not start, or stops answering.
        """
        began_s = time.monotonic()
        self._px4.fly(lambda: self._over)
        self._wall_s += time.monotonic() - began_s

    def _tick(self, simulator: Simulator) -> None:
        """Do what is due in a tick of 1 ms."""
        if simulator is not self._simulator and self._simulator is not None:
            self._epoch_ns = self._now_ns  # PX4 was restarted: its simulator begins again
        self._simulator = simulator
        now = self._now_ns = self._epoch_ns + simulator.tick * TICK_NS
        for sample in simulator.arrived:
            if sample.stamp_ns >= 0:
                position, attitude = self._as_mocap(sample.pose[:3].copy(), sample.pose[3:].copy())
                stamp_ns = self._epoch_ns + sample.stamp_ns
                self._take_pose(Pose(stamp_ns, FRAME_MAP, position, attitude))
        self._run_bridge()
        for topic, message in [entry for one in self._runners for entry in one.run(now)]:
            self._hand_over(topic, message)
            self._note(topic, message)
        if self._began_ns is not None:
            self._log(simulator)
            after_s = self._end.watch(simulator.height, simulator.upright, self._phase)
            if after_s is not None:
                self._end_s = min(self._end_s, self._flown_s + after_s)
            if self._ended_otherwise(simulator):
                self._end_s = min(self._end_s, self._flown_s + _AFTER_DISARM_S)

    def _take_pose(self, pose: Pose) -> None:
        """Take a pose of the motion capture that arrives now."""
        place = (pose.position, pose.attitude)
        self._bridge.pose(pose.stamp_ns, self._now_ns, FRAME_MAP, *place)
        self._hand_over("/mocap/pose", pose)

    def _run_bridge(self) -> None:
        for received in self._received():
            self._bridge.take(received)
        if self._now_ns // TICK_NS % _BRIDGE_TICKS == 0:
            self._take_output(self._bridge.tick(self._now_ns))

    def _received(self) -> list[Received]:
        """Return what PX4 has sent; it arrives now."""
        return [r._replace(arrival_ns=self._now_ns) for r in self._px4.link.receive()]

    def _hand_over(self, topic: str, message: Any) -> None:
        for runner in self._runners:
            runner.take(topic, message)

    def _take_output(self, out: BridgeOutput) -> None:
        for message in out.messages:
            self._px4.link.send(message)
        self._armed_once |= out.status.armed
        if self._px4.armed:
            self._disarmed_s = None
        elif self._armed_once and self._disarmed_s is None:
            self._disarmed_s = self._flown_s
        self._status_why = out.status.why or "; ".join(out.status.findings)
        self._texts += [(self._now_ns, text.text) for text in out.texts]
        self._notes += [(self._now_ns, text) for _, text in out.events]
        for found in out.odometry:
            if found.stamp_ns is None:
                continue
            self._estimates.append((found.stamp_ns, found.position))
            if self._bridge.estimate_trusted:
                moving = rotate_vector(conjugate(found.attitude), found.velocity)
                self._hand_over(
                    "/odometry",
                    Odometry(found.stamp_ns, found.position, found.attitude, moving, found.rates),
                )

    def _note(self, topic: str, message: Any) -> None:
        """Keep the messages that the figures need."""
        if isinstance(message, MissionStatus):
            self._phase = message.phase
            self._began_ns = self._began_ns or self._now_ns
        elif isinstance(message, PositionSetpoint) and topic == "/setpoint":
            self._bridge.stream.setpoint(message, self._now_ns)
            self._setpoint, self._followed_phase = message.position, message.phase
        elif isinstance(message, CollisionEvent):
            self._detections.append((self._now_ns, message))
        elif isinstance(message, ReactionStatus):
            reacting = message.state == ReactionPhase.REACTING
            if reacting and message.collisions > len(self._decisions):
                self._decisions.append(Decision(message.x_c, message.n_r, message.x_r))

    def _log(self, simulator: Simulator) -> None:
        plant = simulator.plant
        state, contact = plant.state, plant.contact
        touches = bool(contact.touching)
        row = {
            "position": state.position.copy(),
            "attitude": state.attitude.copy(),
            "velocity": state.velocity.copy(),
            "rates": state.rates.copy(),
            "fold": plant.fold.copy(),
            "damage": plant.damage.copy(),
            "contact": (touches, int(contact.rotor), *contact.point),
            "contact_force": contact_force(plant) if touches else (0.0, 0.0, 0.0),
            "position_setpoint": self._setpoint,
            "mode": (self._followed_phase,),
        }
        self._rows.append(tuple(row[name] for name in FIGURE_COLUMNS))

    def _ended_otherwise(self, simulator: Simulator) -> bool:
        """Return whether it has flown away, or was brought down by other than the mission."""
        away = float(np.abs(simulator.plant.state.position).max()) > _FARTHEST_M
        down = self._armed_once and not self._px4.armed
        return away or (
            down and self._bridge.session.stage in (SessionStage.READY, SessionStage.GIVEN_UP)
        )

    def result(self) -> LockstepFlight:
        """Return the flight."""
        columns: dict[str, Array] = {
            name: np.array([row[i] for row in self._rows], np.float64)
            for i, name in enumerate(FIGURE_COLUMNS)
        }
        began = self._began_ns or self._now_ns
        summary: dict[str, Any] = {"armed": self._armed_once, "why_not": ""}
        if not self._armed_once or not self._rows:
            summary |= {"seed": self._seed, "crashed": False, "why_not": self._status_why}
            return summary, {}
        seconds: Array = np.arange(len(self._rows), dtype=np.float64) * TICK_S
        detections = [
            detection_of(event, (at - began) * 1e-9, began) for at, event in self._detections
        ]
        known = (detections, self._decisions, self._wall_s)
        flown = Flight({}, t=seconds, log=columns)
        figures, _ = summarize(flown, self._scenario, self._seed, *known)
        distance = self._estimate_errors(columns, began)
        summary |= figures
        summary |= {
            "estimate_error_mean_m": float(distance.mean()) if distance.size else None,
            "estimate_error_max_m": float(distance.max()) if distance.size else None,
            "contacts": contacts(columns["contact"][:, 0]),
            "steps": self._px4.steps,
            "missed": self._px4.missed,
            "notes": [((at - began) * 1e-9, text) for at, text in self._notes],
            "disarmed": not self._px4.armed,
            "disarmed_s": self._disarmed_s,
            "texts": [((at - began) * 1e-9, text) for at, text in self._texts],
        }
        return summary, columns

    def _estimate_errors(self, columns: dict[str, Array], began_ns: int) -> Array:
        """Return how far PX4's positions are from the true ones [m]."""
        errors = []
        for stamp_ns, position in self._estimates:
            at = round((stamp_ns - began_ns) / TICK_NS)
            if 0 <= at < len(self._rows):
                errors.append(float(np.linalg.norm(position - columns["position"][at])))
        return np.array(errors)


def contacts(touching: Array) -> int:
    """Count contacts that have a second without contact before them."""
    at = np.flatnonzero(touching > 0.0) * TICK_S
    return int((np.diff(at, prepend=-math.inf) > 1.0).sum()) if at.size else 0
