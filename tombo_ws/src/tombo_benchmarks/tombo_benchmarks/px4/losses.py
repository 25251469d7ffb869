"""Losses in hover over PX4, a real one or the simulated one, in virtual time.

Each flight takes off, hovers, and loses something: poses, the link, the bridge, the mission. What
PX4 does is seen in its heartbeats, where the vehicle is in the simulation.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.px4.lockstep_flight import LockstepRun
from tombo_benchmarks.px4.lockstep_px4 import LockstepPx4, Px4Setup
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase, Pose, PositionSetpoint
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_px4.bridge.session import BridgeOutput
from tombo_px4.link.mavlink_link import Received
from tombo_px4.modes import mode_name, mode_of
from tombo_sim.simulator import Simulator

_HOVER_S = 4.0
"""Hover before the loss."""
_AFTER_S = 12.0
"""Time observed after the end of the loss, or after the rotors have stopped."""
_LONGEST_S = 60.0
_READY_S = 60.0
_DOWN_M, _UP_M = 0.03, 0.15
"""Heights above its place on the ground: below the first it is down, above the second it flies."""
_BACKLOG = 300
"""Messages that the socket of a stopped bridge keeps."""


@dataclass(frozen=True)
class Loss:
    """A loss in hover."""

    name: str
    kind: str
    """`poses`, `frozen`, `late`, `jumping`, `exchanged`, `link`, `bridge`, `mission`,
    `setpoints`, `px4`."""
    seconds: float = math.inf


LOSSES: Final = (
    Loss("poses stop for 30 s", "poses", 30.0),
    Loss("poses stop for good", "poses"),
    Loss("poses frozen", "frozen"),
    Loss("poses 0.5 s late", "late"),
    Loss("poses jump by 1 m", "jumping"),
    Loss("poses of another body", "exchanged"),
    Loss("link cut for 10 s", "link", 10.0),
    Loss("link cut for good", "link"),
    Loss("bridge killed", "bridge"),
    Loss("bridge stopped for 20 s", "bridge", 20.0),
    Loss("mission killed", "mission"),
    Loss("set points silent", "setpoints"),
    Loss("PX4 restarted", "px4"),
)
"""The rows of the table."""


def hover_scenario() -> Scenario:
    """Return a hover that ends only by a loss."""
    return load_scenario("hover", ["mission.land_time=600", "duration=700"])


def fly_loss(setup: Px4Setup, loss: Loss) -> dict[str, Any]:
    """Fly one loss; return its row.

    Returns:
        `loss`, `seed`; `armed`: it has flown at all; `why_not`, if not; `modes`: time and name of
        each mode of PX4's heartbeats; and what `track_figures` says. Times [s] are from the loss.

    Raises:
        InputError: PX4 does not start, or stops answering.
    """
    scenario = hover_scenario()
    with setup.start(world_of(scenario)) as px4:
        flight = _LossRun(loss, px4, scenario, setup.seed)
        flight.fly()
        return flight.row()


class _LossRun(LockstepRun):
    """A flight that loses something."""

    def __init__(self, loss: Loss, px4: LockstepPx4, scenario: Scenario, seed: int) -> None:
        super().__init__(px4, scenario, seed)
        self.loss = loss
        self._restart_due = False
        """PX4 is to be restarted now."""
        self._began_hover_ns: int | None = None
        self._lost_ns: int | None = None
        self._place = np.zeros(3)
        self._late: deque[tuple[int, Pose]] = deque()
        self._frozen: Pose | None = None
        self._backlog: list[Received] = []
        self._track: list[tuple[float, float, float, bool]] = []
        self._modes: list[tuple[float, str]] = []
        self._stand_m = 0.0
        self._off_since_s: float | None = None

    def fly(self) -> None:
        """Fly until it is over; PX4 is started again where that is the loss."""
        super().fly()
        if self._restart_due:
            self._restart_due = False
            super().fly()

    # --- Time -----------------------------------------------------------------------------------

    @property
    def _loss_s(self) -> float:
        """Time since the loss; negative: before it."""
        return -1.0 if self._lost_ns is None else (self._now_ns - self._lost_ns) * 1e-9

    @property
    def _lost(self) -> bool:
        return 0.0 <= self._loss_s < self.loss.seconds

    def _has_lost(self, kind: str) -> bool:
        return self._lost and self.loss.kind == kind

    @property
    def _over(self) -> bool:
        """The flight is observed to its end, or PX4 is to be restarted."""
        if self._lost_ns is None:
            return (self._now_ns - EPOCH_NS) * 1e-9 > _READY_S
        after_s = self._loss_s
        if self._restart_due or after_s > _LONGEST_S:
            return True
        ended_s = self.loss.seconds if math.isfinite(self.loss.seconds) else 0.0
        off_s = self._off_since_s
        return off_s is not None and after_s > max(ended_s, off_s) + _AFTER_S

    # --- The loss -------------------------------------------------------------------------------

    def _take_pose(self, pose: Pose) -> None:
        if self._has_lost("bridge") or self._has_lost("poses"):
            return
        if self._has_lost("frozen"):
            self._frozen = self._frozen or pose
            pose = replace(self._frozen, stamp_ns=pose.stamp_ns)
        if self._has_lost("late"):
            self._late.append((self._now_ns + SECOND_NS // 2, pose))
            return
        if self._has_lost("jumping") and int(self._loss_s) % 2 == 0:
            pose = replace(pose, position=pose.position + np.array([1.0, 0.0, 0.0]))
        if self._has_lost("exchanged"):
            attitude = np.array([0.0, 0.0, math.sin(0.5), math.cos(0.5)])
            noise = 1e-3 * np.sin(np.arange(3) + self._now_ns * 1e-8)
            pose = replace(pose, position=np.array([2.0, 1.5, 0.2]) + noise, attitude=attitude)
        super()._take_pose(pose)

    def _run_bridge(self) -> None:
        while self._late and self._late[0][0] <= self._now_ns:
            super()._take_pose(self._late.popleft()[1])
        if self._has_lost("bridge"):
            self._backlog = self._received()[:_BACKLOG]
        else:
            super()._run_bridge()

    def _received(self) -> list[Received]:
        received, kept = super()._received(), self._backlog
        self._backlog = []
        for message in received:
            self._watch_heartbeat(message)
        return [] if self._has_lost("link") else kept + received

    def _take_output(self, out: BridgeOutput) -> None:
        if self._has_lost("link"):
            out.messages.clear()
        super()._take_output(out)

    def _hand_over(self, topic: str, message: Any) -> None:
        if not (self._has_lost("mission") and topic.startswith("/mission/")):
            super()._hand_over(topic, message)

    def _note(self, topic: str, message: Any) -> None:
        if self._has_lost("mission") and topic.startswith("/mission/"):
            return
        if self._has_lost("setpoints") and isinstance(message, PositionSetpoint):
            return
        super()._note(topic, message)

    def _watch_heartbeat(self, received: Received) -> None:
        message = received.message
        if message.get_type() != "HEARTBEAT":
            return
        mode = mode_name(mode_of(message.custom_mode))
        armed = bool(message.base_mode & 128)
        mode = mode if armed else "disarmed"
        if self._loss_s < 0.0:
            self._modes = [(0.0, mode)]
        elif not self._modes or self._modes[-1][1] != mode:
            self._modes.append((self._loss_s, mode))

    # --- Observation ----------------------------------------------------------------------------

    def _log(self, simulator: Simulator) -> None:
        state = simulator.plant.state
        if self._began_hover_ns is None and self._phase == Phase.HOVER:
            self._began_hover_ns = self._now_ns
        hovered = self._began_hover_ns
        if self._lost_ns is None:
            if not self._px4.armed and hovered is None:
                self._stand_m = float(state.position[2])
            if hovered is not None and self._now_ns - hovered > _HOVER_S * SECOND_NS:
                self._lost_ns = self._now_ns
                self._place = state.position.copy()
                self._restart_due = self.loss.kind == "px4"
            return
        armed = bool(self._px4.armed)
        if armed:
            self._off_since_s = None
        elif self._off_since_s is None:
            self._off_since_s = self._loss_s
        drift = math.hypot(*(state.position[:2] - self._place[:2]))
        height = float(state.position[2]) - self._stand_m
        self._track.append((self._loss_s, height, drift, armed))

    def row(self) -> dict[str, Any]:
        """Return the row of the loss."""
        row = {"loss": self.loss.name, "seed": self._seed, "armed": self._lost_ns is not None}
        if self._lost_ns is None:
            notes = dict.fromkeys(text for _, text in self._notes)
            why_not = "; ".join(notes) or self._status_why
            return row | {"why_not": why_not, "modes": [], **track_figures(np.zeros((0, 4)))}
        return row | {"modes": self._modes, **track_figures(np.array(self._track))}


def track_figures(track: Array) -> dict[str, Any]:
    """Return the figures of a track: rows of time since the loss, height, drift, and armed.

    Returns:
        `down_s`, when it touched the ground to stay there, and `off_s`, when PX4 was disarmed;
        None: never. `drift_m`, the farthest. `again`: it left the ground or was armed after that.
        `ended`: it is on the ground, disarmed, and has stayed so.
    """
    seconds, height, drift, armed = track.T
    down_s = off_s = None
    again = False
    on, off = np.flatnonzero(height < _DOWN_M), np.flatnonzero(armed < 0.5)
    if on.size:
        again = bool((height[on[0] :] > _UP_M).any())
        down_s = float(seconds[on[0]]) if height[-1] < _DOWN_M else None
    if off.size:
        again = again or bool((armed[off[0] :] > 0.5).any())
        off_s = float(seconds[off[0]]) if armed[-1] < 0.5 else None
    return {
        "down_s": down_s, "off_s": off_s, "drift_m": float(drift.max(initial=0.0)),
        "again": again, "ended": down_s is not None and off_s is not None and not again,
    }  # fmt: skip


def loss_line(row: Mapping[str, Any]) -> str:
    """Return the line about a flight."""
    if not row["armed"]:
        return f"never armed: {row['why_not']}"
    modes = ", ".join(f"{at:.1f} s {name}" for at, name in row["modes"])
    return f"{'down, disarmed, stays so' if row['ended'] else 'NOT ENDED'}; {modes}"


def loss_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of the losses: of several flights the worst figure."""
    head = ("loss", "PX4's modes", "down [s]", "disarmed [s]", "drift [m]", "flies again")
    cells = []
    for loss in dict.fromkeys(row["loss"] for row in rows):
        flights = [row for row in rows if row["loss"] == loss]
        orders = dict.fromkeys(" → ".join(name for _, name in f["modes"]) for f in flights)
        again = sum(f["again"] or not f["armed"] for f in flights)
        times = (_worst([f[key] for f in flights]) for key in ("down_s", "off_s"))
        drift = f"{max(f['drift_m'] for f in flights):.2f}"
        cells.append([loss, "; or ".join(orders), *times, drift, f"{again} of {len(flights)}"])
    return table_markdown(head, cells)


def _worst(times_s: Sequence[float | None]) -> str:
    known = [at for at in times_s if at is not None]
    return "never" if len(known) < len(times_s) else f"{max(known):.1f}"
