"""The checklist before arming: records of a question and its evidence, in order.

PX4 reports nothing about wrong axes, wrong stamps and poses that it does not fuse. Each evidence
is a function of the samples of the last second and of PX4's parameters. It returns the message:
what is wrong, why, and the remedy; "" if nothing is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.bridge.hand_rotation_check import CARRY_M, TURN_RAD, HandVerdict
from tombo_px4.bridge.pose_axes import AxesEvidence, up_error, up_in_pose_body
from tombo_px4.bridge.vehicle_parameters import (
    EV_CTRL,
    EV_DELAY,
    FUSED,
    FindingSeverity,
    explain_parameters,
)
from tombo_px4.link.decoded_messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.timesync import TimeSync

_ADVICE, _WARNING, _BLOCKS = FindingSeverity
_ENOUGH = 8
_SILENT_NS = 200_000_000
_SLOWEST_HZ = 20.0
_STANDS_GYRO, _STANDS_ACCEL = 0.3, 0.5
"""[rad/s], [m/s^2]: a vehicle that stands shows less in a second."""
_NO_TURN, _NO_PUSH = 0.15, 0.8
"""[rad/s], [m/s^2]: a vehicle that stands still shows no more."""
_STILL_GYRO, _STILL_ACCEL = 1e-4, 1e-3
"""[rad/s], [m/s^2]: no sensor is as quiet as this, but a simulated one."""
_FROZEN_NS = 800_000_000
_POSITION_OFF_M = 0.2
"""PX4's position may be so far from the pose at rest: two EKF2_EVP_NOISE."""
_YAW_OFF_RAD = TILT_OFF_RAD = math.radians(10.0)
"""PX4's yaw may differ so much from the pose's, and the pose's up from gravity's. Estimated,
because rigid bodies are defined by eye."""
_IN_FLIGHT = 5.0
"""In flight PX4's position may be off by so many times more."""
_ODOMETRY_SILENT_NS = 500_000_000
_ESTIMATOR_SILENT_NS = 5 * SECOND_NS
_PAIR_NS = 50_000_000
_DELAY_OFF_MS = 20.0
_OTHER_BODY_RAD = 0.035
"""The tilt of a body at rest against gravity tells it from another definition of it: 2 deg."""
_LARGEST_NOISE_M = 0.02
"""[m]: poses of a vehicle at rest have less noise."""
_REQUESTS_NS = 3 * SECOND_NS


@dataclass(frozen=True)
class PreflightFinding:
    """What is wrong, why, and the remedy."""

    key: str
    text: str
    weight: FindingSeverity


class SentPose(NamedTuple):
    """A pose that was sent to PX4."""

    stamp_ns: int
    arrival_ns: int
    position: Array
    attitude: Array


@dataclass
class CheckState:
    """What the checks are asked about.

    Attributes:
        now_ns: the present.
        params: of the bridge.
        values: parameters of the vehicle, as far as known.
        unwritten: those that it did not accept.
        sync: with the vehicle's clock.
        answered: how many of its TIMESYNC requests were answered.
        linked_ns: since when it is there.
        flying: it is in the air; what can be judged at rest only is left out.
        poses, imu, odometry: of the last second, the oldest first.
        first_ns, last_ns: arrival of the first and the newest pose; 0: none.
        refused: why poses were not sent within the last second, and their age [s].
        estimator: what PX4 said last about it.
        verdict: of the last motion by hand.
        proof: of the axes of this body.
        refuted: what was shown to be wrong, until a new proof.
    """

    now_ns: int
    params: BridgeParams
    values: Mapping[str, float | int]
    unwritten: Mapping[str, float]
    sync: TimeSync
    answered: int
    linked_ns: int
    flying: bool
    poses: Sequence[SentPose]
    imu: Sequence[VehicleImu]
    odometry: Sequence[VehicleOdometry]
    first_ns: int
    last_ns: int
    refused: Mapping[PoseRefusal, float]
    estimator: EstimatorStatusFlags | None
    verdict: HandVerdict | None
    proof: AxesEvidence | None
    refuted: str

    @property
    def fresh(self) -> bool:
        """Poses are coming."""
        return self.now_ns - self.last_ns <= _SILENT_NS

    @property
    def told(self) -> EstimatorStatusFlags | None:
        """What PX4 has said of its estimator; None: nothing lately."""
        told = self.estimator
        silent = told is None or self.now_ns - told.arrival_ns > _ESTIMATOR_SILENT_NS
        return None if silent else told

    @cached_property
    def places(self) -> Array:
        """Positions (N, 3) of the poses [m]; none where they are too few, or old."""
        enough = self.fresh and len(self.poses) >= _ENOUGH
        return np.array([p.position for p in self.poses] if enough else []).reshape(-1, 3)

    @cached_property
    def felt(self) -> tuple[Array, Array] | None:
        """Rates and specific forces (N, 3) of PX4's sensors; None: too few."""
        if len(self.imu) < _ENOUGH:
            return None
        return np.array([s.gyro for s in self.imu]), np.array([s.accel for s in self.imu])

    @cached_property
    def at_rest(self) -> bool:
        """PX4's sensors show a vehicle that stands."""
        if self.felt is None:
            return False
        gyro, accel = self.felt
        stands = np.ptp(gyro, axis=0).max() < _STANDS_GYRO
        return bool(stands and accel.std(axis=0).max() < _STANDS_ACCEL)

    @cached_property
    def tilt_at_rest(self) -> tuple[float, float] | None:
        """How the tracked body's z is tilted in the vehicle [rad]; None: it is moved."""
        if len(self.poses) < _ENOUGH or self.felt is None or not self.at_rest:
            return None
        accel = self.felt[1].mean(axis=0)
        tilts = [up_in_pose_body(p.attitude, accel) for p in self.poses]
        about_y, about_x = np.mean(tilts, axis=0).tolist()
        return about_y, about_x

    @cached_property
    def pairs(self) -> tuple[Array, Array, float] | None:
        """Position of the pose, that of PX4, and yaw of the pose against PX4's.

        All of the same time, medians over the last second; None without enough of both.
        """
        lately = [o for o in self.odometry if o.stamp_ns is not None]
        if min(len(self.poses), len(lately)) < _ENOUGH:
            return None
        stamps = np.array([p.stamp_ns for p in self.poses])
        seen = np.array([o.stamp_ns for o in lately])
        right = np.clip(np.searchsorted(stamps, seen), 1, len(stamps) - 1)
        nearest = right - (seen - stamps[right - 1] < stamps[right] - seen)
        away = stamps[nearest] - seen
        near = np.abs(away) <= _PAIR_NS
        if near.sum() < _ENOUGH:
            return None
        nearest, away = nearest[near], away[near]
        theirs = np.array([o.position for o in lately])[near]
        theirs += 1e-9 * away[:, None] * np.array([o.velocity for o in lately])[near]
        ours = np.array([p.position for p in self.poses])[nearest]
        yaw = yaw_pitch_roll(np.array([o.attitude for o in lately])[near])[:, 0]
        our_yaw = yaw_pitch_roll(np.array([p.attitude for p in self.poses])[nearest])[:, 0]
        turn = float(np.angle(np.exp(1j * (our_yaw - yaw)).sum()))
        return np.median(ours, axis=0), np.median(theirs, axis=0), turn


@dataclass(frozen=True)
class Check:
    """A question of the checklist.

    Attributes:
        key: of its finding.
        question: that must be answered with yes.
        evidence: the message, if the answer is no.
        weight: of the finding.
        unless: keys of earlier findings that explain it: then it is not asked.
    """

    key: str
    question: str
    evidence: Callable[[CheckState], str]
    weight: FindingSeverity = _BLOCKS
    unless: tuple[str, ...] = ()


def findings_of(state: CheckState) -> list[PreflightFinding]:
    """Ask all questions in order; return what is wrong, the worst first."""
    found: dict[str, PreflightFinding] = {}
    for check in CHECKS:
        if not found.keys() & {check.key, *check.unless} and (text := check.evidence(state)):
            found[check.key] = PreflightFinding(check.key, text, check.weight)
    return sorted(found.values(), key=lambda finding: -finding.weight)


# --- Poses ---------------------------------------------------------------------------------------


def latency_s(poses: Sequence[SentPose]) -> float:
    """Return the usual time from a pose's capture to its arrival here [s]; NaN: no poses."""
    ages_s = [(p.arrival_ns - p.stamp_ns) * 1e-9 for p in poses]
    return float(np.median(ages_s)) if ages_s else math.nan


def _show_refusal(why: PoseRefusal, state: CheckState) -> str:
    age_s = state.refused.get(why)
    if age_s is None:
        return ""
    return _REFUSED[why].format(age=age_s, ahead=-age_s, limit=state.params.pose_age_max)


def _show_silence(state: CheckState) -> str:
    if state.fresh or state.refused:
        return ""
    silence = f" for {(state.now_ns - state.last_ns) * 1e-9:.1f} s" if state.last_ns else ""
    return (
        f"no mocap pose has come{silence}: is the driver running, is the body tracked, is the"
        " topic /mocap/pose?"
    )


def _show_frozen(state: CheckState) -> str:
    poses, felt = state.poses, state.felt
    if state.flying or len(state.places) == 0:
        return ""
    trembles = felt is None or (
        felt[0].std(axis=0).max() > _STILL_GYRO or felt[1].std(axis=0).max() > _STILL_ACCEL
    )
    long = poses[-1].arrival_ns - poses[0].arrival_ns >= _FROZEN_NS
    changes = np.ptp(state.places, axis=0).any() or np.ptp([p.attitude for p in poses], 0).any()
    if changes or not (long and trembles):
        return ""
    return (
        "mocap pose is frozen: not one bit has changed for a second; the tracker repeats its last"
        " pose, the body is not seen (or it is simulated, without noise)"
    )


def _show_bodies(state: CheckState) -> str:
    apart = bodies_apart(state.places) if len(state.places) else 0.0
    if apart <= 0.0:
        return ""
    return (
        f"mocap poses of two bodies or more take turns in one topic, {apart:.2f} m apart: give"
        " each body a topic of its own"
    )


def _show_motion_at_rest(state: CheckState) -> str:
    at_rest = not state.flying and len(state.places) > 0 and state.at_rest
    spread = float(state.places.std(axis=0).max()) if at_rest else 0.0
    if spread <= _LARGEST_NOISE_M:
        return ""
    return (
        f"mocap poses move by {spread:.2g} m (standard deviation) while PX4's sensors are at rest:"
        " another body is tracked, or poses are in millimetres"
    )


def _show_rate(state: CheckState) -> str:
    known, rate = state.fresh and state.now_ns - state.first_ns > SECOND_NS, len(state.poses)
    if not known or rate >= _SLOWEST_HZ:
        return ""
    return f"mocap poses come at {rate} Hz: EKF2 wants {_SLOWEST_HZ:.0f} Hz and more"


# --- Time ----------------------------------------------------------------------------------------


def _show_timesync(state: CheckState) -> str:
    if state.sync.converged:
        return ""
    return (
        "TIMESYNC has not converged: PX4's answers are missing or too few; stamps can't be"
        " compared. Does the link work both ways?"
    )


def _show_unasked(state: CheckState) -> str:
    if state.answered or state.now_ns - state.linked_ns <= _REQUESTS_NS:
        return ""
    return (
        "PX4 has not asked for our time (TIMESYNC): it takes the arrival of poses for their"
        " capture; enable TIMESYNC on its link (MAV_0_MODE onboard)"
    )


# --- PX4's parameters and its use of the poses ---------------------------------------------------


def _show_unwritten(state: CheckState) -> str:
    pairs = ", ".join(f"{name}={value:g}" for name, value in state.unwritten.items())
    if not pairs:
        return ""
    return f"PX4 did not take: {pairs}; is the name right, the value within its bounds?"


def _show_loss_parameters(state: CheckState) -> str:
    wrong = explain_parameters(state.values, _BLOCKS)
    if not wrong:
        return ""
    return (
        f"a loss in flight would not end on the ground: {wrong}. With your consent the bridge sets"
        " them: --bridge px4_parameters=safe"
    )


def _show_mocap_parameters(state: CheckState) -> str:
    wrong = explain_parameters(state.values, _WARNING)
    if not wrong:
        return ""
    return f"{wrong}; --bridge px4_parameters=mocap sets all of them but EKF2_EV_DELAY"


def _show_unfused(state: CheckState) -> str:
    control = int(state.values.get(EV_CTRL, FUSED))
    if not control & 1:
        return f"position is not fused: EKF2_EV_CTRL is {control}, without bit 0; set it to 11"
    told = state.told
    if told is None or not state.poses or (told.is_aided and told.has_position):
        return ""
    return (
        "PX4 knows no position though poses are sent: nothing is fused; EKF2_EV_CTRL, stamps, or"
        " poses that jump"
    )


def _show_refused_by_px4(state: CheckState) -> str:
    told = state.told
    # NaN where no source is fused; max() of it depends on the order
    ratios = () if told is None else (told.position_ratio, told.height_ratio)
    ratio = max((r for r in ratios if r > 1.0), default=0.0)
    if ratio == 0.0:
        return ""
    return (
        f"PX4 refuses the poses: innovation test ratio {ratio:.1f}, accepted below 1; its estimate"
        " is elsewhere: axes, stamps, or restart it"
    )


def _show_no_position(state: CheckState) -> str:
    last_ns = state.odometry[-1].arrival_ns if state.odometry else 0
    if state.now_ns - last_ns <= _ODOMETRY_SILENT_NS:
        return ""
    return "PX4 sends no position (ODOMETRY): it has no estimate, or the link is too slow"


def _show_position(state: CheckState) -> str:
    if state.pairs is None:
        return ""
    ours, theirs, _ = state.pairs
    off, limit = math.dist(ours, theirs), _POSITION_OFF_M
    if off <= limit * (_IN_FLIGHT if state.flying else 1.0):
        return ""
    return (
        f"PX4's position is {off:.2f} m away from the pose: pose ({_place(ours)}), PX4"
        f" ({_place(theirs)}); are the poses fused (EKF2_EV_CTRL 11, EKF2_HGT_REF 3), does another"
        " sensor, or another sender with other axes, feed PX4?"
    )


def _show_yaw(state: CheckState) -> str:
    turn = 0.0 if state.pairs is None else state.pairs[2]
    if abs(turn) <= _YAW_OFF_RAD:
        return ""
    return (
        f"yaw of mocap body differs from PX4 by {math.degrees(turn):+.0f} deg: x of the rigid body"
        " is not the nose, or PX4's heading comes from the magnetometer (EKF2_EV_CTRL bit 3)"
    )


# --- Axes ----------------------------------------------------------------------------------------


def _show_no_imu(state: CheckState) -> str:
    if state.flying or state.felt is not None:
        return ""
    return "PX4 sends no HIGHRES_IMU: which way is up can't be checked"


def _show_moved(state: CheckState) -> str:
    if state.flying or state.felt is None or not state.poses:
        return ""
    gyro, accel = (float(np.linalg.norm(v.mean(axis=0))) for v in state.felt)
    moved = gyro > _NO_TURN or abs(accel - GRAVITY) > _NO_PUSH
    return "the vehicle is moved: put it down" if moved else ""


def _show_up(state: CheckState) -> str:
    """Compare +z of the pose with gravity, unless a motion by hand says what is wrong."""
    verdict = state.verdict
    named = verdict is not None and verdict.mistake and verdict.sure
    if state.flying or state.felt is None or not state.poses or named:
        return ""
    error = up_error(state.poses[-1].attitude, state.felt[1].mean(axis=0))
    if error <= TILT_OFF_RAD:
        return ""
    return (
        f"by its pose the vehicle at rest is tilted by {math.degrees(error):.0f} deg: either the"
        " quaternion is w first (let the driver fill x, y, z, w); or the pose is Y-up (set the"
        " streamed up axis to Z; OptiTrack Motive: Streaming, Up Axis); or it is one of a z-down"
        " body (NED, FRD: send ENU and FLU); or the body was defined tilted (define it again with"
        " the vehicle level and its nose along +x); turn and carry it by hand, which tells them"
        " apart"
    )


def _show_mistake(state: CheckState) -> str:
    return "" if state.verdict is None else state.verdict.mistake


def _show_proof(state: CheckState) -> str:
    proof, tilt, verdict = state.proof, state.tilt_at_rest, state.verdict
    simulated = state.params.axes_evidence == SIMULATED and not state.refuted
    off = 0.0 if proof is None or tilt is None else math.dist(proof.tilt_rad, tilt)
    if state.flying or simulated or (proof is not None and off <= _OTHER_BODY_RAD):
        return ""
    because = f" ({state.refuted})" if state.refuted else ""
    if proof is not None:
        because = (
            f" (the proof of {proof.date} was of another body: it lay {math.degrees(off):.1f} deg"
            " differently in the vehicle)"
        )
    text = (
        f"the axes of the poses are not proven{because}: propellers off, turn the vehicle by hand"
        f" about each axis, {TURN_RAD:g} rad in all, and carry it briskly, {CARRY_M:g} m in all"
        " along each axis, within 40 s; then put it down"
    )
    if verdict is None:
        return text
    turned, carried = (
        ", ".join(f"{v:.1f}" for v in way) for way in (verdict.turned, verdict.carried)
    )
    return (
        f"{text} (until now: turned {turned} rad, carried {carried} m, {verdict.least_carried:.1f}"
        " m in the direction of least motion)"
    )


def _show_stamp_delay(state: CheckState) -> str:
    delay_ms = math.nan if state.verdict is None else 1e3 * state.verdict.delay_s
    told_ms = state.values.get(EV_DELAY, 0.0)
    if not abs(delay_ms - told_ms) > _DELAY_OFF_MS:  # so without a motion by hand: NaN
        return ""
    return (
        f"poses show the vehicle as it was {delay_ms:.0f} ms before their stamps (gyro compared),"
        f" EKF2_EV_DELAY is {told_ms:.0f} ms: let the driver stamp the capture, or set it to"
        f" {max(delay_ms, 0.0):.0f}"
    )


def _place(position: Array) -> str:
    return ", ".join(f"{p:.2f}" for p in position)


_REFUSED = {
    PoseRefusal.FUTURE: (
        "mocap stamps are {ahead:.3g} s in the future: the clock of the mocap computer is ahead;"
        " let chrony or NTP set both clocks"
    ),
    PoseRefusal.LATE: (
        "mocap stamps are {age:.3g} s old when they arrive, accepted are {limit:g} s: the clock"
        " of the mocap computer is behind (chrony, NTP), or the network is late"
    ),
    PoseRefusal.WRONG_FRAME: "mocap poses are not in frame map: let the driver publish in map",
    PoseRefusal.NOT_FINITE: "mocap poses contain NaN or infinity: the tracker has lost the body",
    PoseRefusal.NOT_UNIT: "mocap quaternions are no rotations: the driver fills them wrongly",
    PoseRefusal.OUT_OF_ORDER: "mocap stamps do not grow: two drivers at work?",
    PoseRefusal.JUMP: (
        "mocap poses are elsewhere than PX4 in flight: another body, or exchanged markers"
    ),
    PoseRefusal.TWO_PUBLISHERS: "two nodes publish mocap poses: stop one of them",
    PoseRefusal.REPEATED: (
        "mocap repeats its last pose though the vehicle moves: the tracker does not see the body"
    ),
    PoseRefusal.DISTRUSTED: "poses were judged wrong in this flight: no pose is sent any more",
}
CHECKS = (
    Check("parameters_not_set", "did PX4 take what it was told?", _show_unwritten),
    *(
        Check(f"pose_{why.key}", "can each pose be used?", partial(_show_refusal, why))
        for why in _REFUSED
    ),
    Check("pose_stale", "do poses come?", _show_silence),
    Check("pose_frozen", "do their bits change?", _show_frozen, _WARNING),
    Check("pose_bodies", "are they of one body?", _show_bodies),
    Check(
        "pose_moves",
        "do they rest with the vehicle, in metres?",
        _show_motion_at_rest,
        unless=("pose_bodies",),
    ),
    Check("pose_rate", "do they come often enough?", _show_rate, _WARNING),
    Check("timesync", "are the clocks compared?", _show_timesync),
    Check("timesync_unasked", "does PX4 use it?", _show_unasked, _WARNING, ("timesync",)),
    Check("loss_parameters", "does a loss end on the ground?", _show_loss_parameters),
    Check("mocap_parameters", "is mocap alone fused?", _show_mocap_parameters, _WARNING),
    Check(
        "link_parameters",
        "can it be armed by this link alone?",
        lambda state: explain_parameters(state.values, _ADVICE),
        _ADVICE,
    ),
    Check("not_fused", "does PX4 fuse the poses?", _show_unfused),
    Check("poses_refused", "do they pass its gate?", _show_refused_by_px4),
    Check("no_position", "does it send its position?", _show_no_position),
    Check("position_differs", "is it there?", _show_position, unless=("no_position",)),
    Check("yaw_differs", "does it point there?", _show_yaw, unless=("no_position",)),
    Check("no_imu", "does it send its sensors?", _show_no_imu),
    Check("moved", "does the vehicle stand?", _show_moved, _WARNING),
    Check("mocap_up", "does +z of the poses point up?", _show_up, unless=("moved",)),
    Check("mocap_axes", "did a motion by hand agree?", _show_mistake),
    Check("axes_unproven", "has it proven the axes?", _show_proof),
    Check("stamp_delay", "did its stamps agree?", _show_stamp_delay, _WARNING, ("mocap_axes",)),
)
"""The questions: poses, time, parameters, what PX4 makes of the poses, axes."""
