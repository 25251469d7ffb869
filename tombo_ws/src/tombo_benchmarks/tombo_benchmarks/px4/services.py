"""Each request of an operator in each state of a flight over PX4, in virtual time.

A request is obeyed, and the vehicle shows it, or it is refused with a reason. Whatever is asked,
the vehicle does not fly away, and does not stay armed on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tombo_benchmarks.px4.lockstep_flight import LockstepRun
from tombo_benchmarks.px4.lockstep_px4 import LockstepPx4, Px4Setup
from tombo_benchmarks.px4.losses import hover_scenario
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase, Pose
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS
from tombo_flight.scenario import Scenario, world_of
from tombo_px4.bridge.session import BridgeOutput, Reply, SessionStage
from tombo_px4.modes import OFFBOARD, mode_name
from tombo_sim.simulator import Simulator

_HOVERS_S: Final = 3.0
"""Hover of the plan before the first request."""
_WATCHED_S: Final = 16.0
"""Time observed after the answer: PX4 disarms 2 s after landing, 10 s after an arming."""
_LONGEST_S: Final = 90.0
_ON_GROUND_M, _FLIES_M, _HIGHEST_M, _FARTHEST_M = 0.1, 0.3, 2.6, 0.5
"""Heights above the stand, and the largest distance from the place of the request."""


@dataclass(frozen=True)
class State:
    """A state of the flight, and how it is reached.

    Attributes:
        flies: the plan takes off first, and hovers.
        before: requests that lead there.
        wait_s: between the last of them, or the loss of poses, and the request.
        poses: the motion capture goes on.
    """

    flies: bool
    before: tuple[str, ...] = ()
    wait_s: float = 1.0
    poses: bool = True


STATES: Final[Mapping[str, State]] = {
    "ready": State(flies=False),
    "armed on the ground": State(flies=False, before=("arm",)),
    "hover": State(flies=True),
    "hold": State(flies=True, before=("hold",)),
    "landing": State(flies=True, before=("land",)),
    "touched down": State(flies=True, before=("land",), wait_s=5.5),
    "killed": State(flies=True, before=("kill",), wait_s=4.0),
    "poses lost": State(flies=True, poses=False, wait_s=2.0),
}

SHOWS: Final[Mapping[str, Callable[[Array], bool]]] = {
    "arm": lambda t: bool(t[:, 3].any()),
    "disarm": lambda t: not t[-1, 3],
    "takeoff": lambda t: bool(t[:, 0].max() > _FLIES_M),
    "land": lambda t: bool(t[-1, 0] < _ON_GROUND_M and not t[-1, 3]),
    "hold": lambda t: bool(t[:, 3].all() and abs(t[-1, 0] - t[0, 0]) < _FLIES_M),
    "offboard": lambda t: bool(t[:, 2].any()),
    "kill": lambda t: not t[-1, 3],
}
"""Service -> whether the track from the answer on shows that it was obeyed.

A track has columns: height, distance, whether its mode is OFFBOARD, and armed.
"""


class _ServiceRun(LockstepRun):
    """A flight with a request in a state."""

    def __init__(
        self, service: str, state: State, px4: LockstepPx4, scenario: Scenario, seed: int
    ) -> None:
        super().__init__(px4, scenario, seed)
        self._state = state
        self._requests = [*state.before, service]
        self._begun_ns = self._due_ns = self._asked_ns = self._answered_ns = 0
        self._number, self._offboard = 0, False
        self.reply: Reply | None = None
        self._place: Array | None = None
        self._stand_m = math.nan
        self.track: list[tuple[float, float, bool, bool]] = []

    @property
    def _over(self) -> bool:
        watched_s = (self._now_ns - self._answered_ns) * 1e-9 if self._answered_ns else 0.0
        return watched_s > _WATCHED_S or (self._now_ns - EPOCH_NS) * 1e-9 > _LONGEST_S

    def _take_pose(self, pose: Pose) -> None:
        if self._state.poses or not self._begun_ns or self._now_ns < self._begun_ns:
            super()._take_pose(pose)

    def _hand_over(self, topic: str, message: Any) -> None:
        if self._state.flies or topic != "/odometry":  # without it the plan does not begin
            super()._hand_over(topic, message)

    def _take_output(self, out: BridgeOutput) -> None:
        now_ns, self._offboard = self._now_ns, out.status.mode == mode_name(OFFBOARD)
        ready = out.status.stage == SessionStage.READY
        if not self._begun_ns and (self._phase == Phase.HOVER if self._state.flies else ready):
            self._begun_ns = now_ns + int(_HOVERS_S * SECOND_NS)
            self._due_ns = self._begun_ns + self._wait_ns
        if self._due_ns and now_ns >= self._due_ns and self._requests and not self._number:
            self._number = self._bridge.session.request(self._requests.pop(0))
            self._asked_ns = now_ns
        for reply in out.replies:
            if reply.number == self._number:
                self._number, self._due_ns = 0, now_ns + self._wait_ns
                if not self._requests:
                    self.reply, self._answered_ns = reply, now_ns
        super()._take_output(out)

    @property
    def _wait_ns(self) -> int:
        """Time before the next request: the last one waits until the state is reached."""
        return int(self._state.wait_s * SECOND_NS) if len(self._requests) == 1 else 0

    def _tick(self, simulator: Simulator) -> None:
        super()._tick(simulator)
        position = simulator.plant.state.position
        if math.isnan(self._stand_m):
            self._stand_m = float(position[2])
        if not self._asked_ns or self._requests:
            return
        self._place = position.copy() if self._place is None else self._place
        if self._answered_ns:
            away = math.hypot(*(position[:2] - self._place[:2]))
            height = float(position[2]) - self._stand_m
            self.track.append((height, away, self._offboard, bool(self._px4.armed)))


def fly_service(setup: Px4Setup, service: str, state: str) -> dict[str, Any]:
    """Ask for a service in a state of `STATES`; return a row; `wrong` is "" if all is right.

    Raises:
        InputError: PX4 does not start, or stops answering.
    """
    scenario = hover_scenario()
    with setup.start(world_of(scenario)) as px4:
        run = _ServiceRun(service, STATES[state], px4, scenario, setup.seed)
        run.fly()
    reply = run.reply
    row = {"state": state, "service": service, "seed": setup.seed}
    if reply is None or not run.track:
        return row | {"answer": "", "wrong": "no answer"}
    track = np.array(run.track)
    far = bool(track[:, 0].max() > _HIGHEST_M or track[:, 1].max() > _FARTHEST_M)
    armed_on_ground = bool(track[-1, 0] < _ON_GROUND_M and track[-1, 3])
    shown = SHOWS[service](track) if reply.success else bool(reply.text)
    wrong = ["flew away"] * far + ["armed on the ground"] * armed_on_ground
    wrong += [] if shown else ["answer is not true"]
    answer = f"{'done' if reply.success else 'refused'}: {reply.text}"
    return row | {"answer": answer, "wrong": ", ".join(wrong)}
