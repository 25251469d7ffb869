"""The checklist before arming: each check is a question with its evidence and its message.

PX4 reports nothing about wrong axes, wrong stamps and poses that it does not fuse. So each
evidence looks at the samples of the last second and at PX4's parameters. It returns the message:
fault, cause and remedy; "" without a fault.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import takewhile
from typing import NamedTuple, TypeVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.rotation import rotate_vector, up_in_body, yaw_pitch_roll
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.axes_proof import (
    CARRY_M,
    TURN_RAD,
    AxesEvidence,
    HandVerdict,
    MotionCheck,
    valid_proof,
)
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.bridge.vehicle_parameters import (
    EV_CTRL,
    EV_DELAY,
    FUSED,
    FindingSeverity,
    explain_parameters,
)
from tombo_px4.link.messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.timesync import TimeSync

_ADVICE, _WARNING, _BLOCKS = FindingSeverity
_WINDOW_NS = SECOND_NS
_KEPT = 600
_LEAST_SAMPLES = 8
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
"""Largest distance of PX4's position from the pose at rest: two EKF2_EVP_NOISE."""
_YAW_OFF_RAD = _TILT_OFF_RAD = math.radians(10.0)
"""Largest difference of PX4's yaw from the pose's, and of the pose's up from gravity's. Estimated,
because rigid bodies are defined by eye."""
_IN_FLIGHT = 5.0
"""Factor on the largest difference of PX4's position in flight."""
_ODOMETRY_SILENT_NS = 500_000_000
_ESTIMATOR_SILENT_NS = 5 * SECOND_NS
_GAP_NS = 100_000_000
"""Between two poses further apart no pose is interpolated."""
_DELAY_OFF_MS = 20.0
_OTHER_BODY_RAD = 0.035
"""The tilt of a body at rest against gravity tells it from another definition of it: 2 deg."""
_LARGEST_NOISE_M = 0.02
"""[m]: poses of a vehicle at rest have less noise."""
_REQUESTS_NS = 3 * SECOND_NS


class PreflightFinding(NamedTuple):
    """A fault, its cause and the remedy."""

    key: str
    text: str
    weight: FindingSeverity


class SentPose(NamedTuple):
    """A pose that was sent to PX4."""

    stamp_ns: int
    arrival_ns: int
    position: Array
    attitude: Array


_Arrived = TypeVar("_Arrived", SentPose, VehicleImu, VehicleOdometry)


def _lately(samples: deque[_Arrived], now_ns: int) -> list[_Arrived]:
    """Return those of the last second, oldest first, without looking at the older ones."""
    recent = list(takewhile(lambda s: now_ns - s.arrival_ns < _WINDOW_NS, reversed(samples)))
    return recent[::-1]


class Preflight:
    """Collects poses and telemetry, keeps the proof of the axes, asks the questions.

    Attributes:
        vehicle: hardware id of the autopilot; empty: not known yet.
        odometry: PX4's estimates; the caller adds them.
        estimator: what PX4 said last about its estimator; the caller sets it.
        motion: what moving the vehicle by hand has shown.
        evidence: the last proof of the axes of this body; None: there is none, or it was refuted.
    """

    def __init__(self, params: BridgeParams, proofs: Sequence[AxesEvidence] = ()) -> None:
        """Make the checks; `proofs` are those of the tracked body."""
        self.params, self._proofs = params, proofs
        self.vehicle = ""
        self._poses: deque[SentPose] = deque(maxlen=_KEPT)
        self._refused: dict[PoseRefusal, tuple[int, float]] = {}
        self._imu: deque[VehicleImu] = deque(maxlen=_KEPT)
        self.odometry: deque[VehicleOdometry] = deque(maxlen=_KEPT)
        self.estimator: EstimatorStatusFlags | None = None
        self._judged_ns = 0
        self.motion = MotionCheck(_TILT_OFF_RAD)
        self.evidence: AxesEvidence | None = None
        self._new_evidence: AxesEvidence | None = None
        self._proved: HandVerdict | None = None
        self.refuted = ""
        """Fault of the axes, until a new proof."""

    def pose(self, stamp_ns: int, arrival_ns: int, position: Array, attitude: Array) -> None:
        """Take a pose that was sent to PX4."""
        self._poses.append(SentPose(stamp_ns, arrival_ns, position, attitude))
        self.motion.pose(stamp_ns, position, attitude)

    def refused_pose(self, why: PoseRefusal, now_ns: int, age_s: float = 0.0) -> None:
        """Record a pose that was not sent, and its age."""
        self._refused[why] = (now_ns, age_s)

    def imu(self, sample: VehicleImu) -> None:
        """Take a sample of PX4's sensors."""
        self._imu.append(sample)
        if sample.stamp_ns is not None:
            self.motion.imu(sample.stamp_ns, sample.gyro, sample.accel)

    def reset(self) -> None:
        """Forget everything: another vehicle, a restart of it, or a clock that was set."""
        for samples in (self._poses, self._refused, self._imu, self.odometry):
            samples.clear()
        self._judged_ns, self.estimator = 0, None
        self.motion.reset()

    def take_vehicle(self, hardware_id: str) -> None:
        """Take the hardware id of the autopilot: the last proof with it is valid."""
        if hardware_id != self.vehicle:
            self.vehicle = hardware_id
            self.evidence = valid_proof(self._proofs, hardware_id)

    def take_evidence(self) -> AxesEvidence | None:
        """Return the evidence since the last call, to be kept; None: nothing new."""
        evidence, self._new_evidence = self._new_evidence, None
        return evidence

    def refute(self, mistake: str, now_ns: int) -> None:
        """Record that the axes are wrong, whatever was proven before."""
        self.evidence, self.refuted = None, mistake
        self._new_evidence = self._make_evidence(now_ns, mistake=mistake)

    def latency_s(self, now_ns: int) -> float:
        """Return the usual time from a pose's capture to its arrival here [s]; NaN: no poses."""
        ages_s = [(p.arrival_ns - p.stamp_ns) * 1e-9 for p in _lately(self._poses, now_ns)]
        return float(np.median(ages_s)) if ages_s else math.nan

    @property
    def latest_position(self) -> Array | None:
        """Position (3) of the newest pose, map [m]; None: none has come."""
        return self._poses[-1].position if self._poses else None

    def pose_rate_hz(self, now_ns: int) -> float:
        """Return how many poses came within the last second."""
        return len(_lately(self._poses, now_ns)) / (_WINDOW_NS * 1e-9)

    def findings(
        self,
        now_ns: int,
        sync: TimeSync,
        values: Mapping[str, float | int],
        *,
        linked_ns: int,
        answered: int,
        flying: bool,
        unwritten: Mapping[str, float] | None = None,
    ) -> list[PreflightFinding]:
        """Ask all questions in order; return the faults, the worst first.

        Args:
            now_ns: the present.
            sync: with the vehicle's clock.
            values: parameters of the vehicle, as far as known.
            linked_ns: since when it is there.
            answered: how many of its TIMESYNC requests were answered.
            flying: it is in the air; checks at rest only are left out.
            unwritten: parameters that it did not accept.
        """
        self.now_ns, self.sync, self.values, self.flying = now_ns, sync, values, flying
        self.linked_ns, self.answered, self.unwritten = linked_ns, answered, unwritten or {}
        self._judge_motion()
        self._read_samples()
        if not flying:
            self._keep_proof()
        wrong: dict[str, PreflightFinding] = {}
        for check in CHECKS:
            if not wrong.keys() & {check.key, *check.unless} and (text := check.evidence(self)):
                wrong[check.key] = PreflightFinding(check.key, text, check.weight)
        return sorted(wrong.values(), key=lambda finding: -finding.weight)

    # --- What the evidence looks at ---------------------------------------------------------

    def _read_samples(self) -> None:
        """Look at the last second."""
        now_ns = self.now_ns
        self.poses, self.samples = _lately(self._poses, now_ns), _lately(self._imu, now_ns)
        self.last_ns = self._poses[-1].arrival_ns if self._poses else 0
        self.known_s = (now_ns - self._poses[0].arrival_ns) * 1e-9 if self._poses else 0.0
        self.fresh = now_ns - self.last_ns <= _SILENT_NS
        """Poses are coming."""
        ages = self._refused.items()
        self.refused = {why: age_s for why, (at, age_s) in ages if now_ns - at <= _WINDOW_NS}
        """Why poses were not sent, and their age [s]."""
        enough = self.fresh and len(self.poses) >= _LEAST_SAMPLES
        places = [p.position for p in self.poses] if enough else []
        self.places = np.array(places).reshape(-1, 3)
        """Positions (N, 3) of the poses [m]; none where they are too few, or old."""
        told = self.estimator
        silent = told is None or now_ns - told.arrival_ns > _ESTIMATOR_SILENT_NS
        self.told = None if silent else told
        """What PX4 has said of its estimator; None: nothing lately."""
        self.felt: tuple[Array, Array] | None = None
        """Rates and specific forces (N, 3) of PX4's sensors; None: too few."""
        self.at_rest = False
        """PX4's sensors show a vehicle that stands."""
        if len(self.samples) >= _LEAST_SAMPLES:
            gyro, accel = (np.array([getattr(s, k) for s in self.samples]) for k in _SENSORS)
            self.felt = gyro, accel
            stands = np.ptp(gyro, axis=0).max() < _STANDS_GYRO
            self.at_rest = bool(stands and accel.std(axis=0).max() < _STANDS_ACCEL)
        self.tilt = self._tilt_at_rest()
        self.pairs = self._pairs()

    def _tilt_at_rest(self) -> tuple[float, float] | None:
        """Return how the tracked body's z is tilted in the vehicle [rad]; None: it is moved."""
        if len(self.poses) < _LEAST_SAMPLES or self.felt is None or not self.at_rest:
            return None
        tilts = up_in_body(np.array([p.attitude for p in self.poses]))
        x, y, _ = (tilts.mean(axis=0) - _direction(self.felt[1].mean(axis=0))).tolist()
        return x, y

    def _pairs(self) -> tuple[Array, Array, float] | None:
        """Return position of the pose, that of PX4, and yaw of the pose against PX4's.

        All of the same time, medians over the last second; None without enough of both.
        """
        lately = [o for o in _lately(self.odometry, self.now_ns) if o.stamp_ns is not None]
        if min(len(self.poses), len(lately)) < _LEAST_SAMPLES:
            return None
        stamps = np.array([p.stamp_ns for p in self.poses])
        seen = np.array([o.stamp_ns for o in lately])
        after = np.clip(np.searchsorted(stamps, seen), 1, len(stamps) - 1)
        inside = (stamps[0] <= seen) & (seen <= stamps[-1])
        use = inside & (stamps[after] - stamps[after - 1] <= _GAP_NS)
        if use.sum() < _LEAST_SAMPLES:
            return None
        seen = seen[use]
        our_yaw = np.unwrap(yaw_pitch_roll(np.array([p.attitude for p in self.poses]))[:, 0])
        columns = [*np.array([p.position for p in self.poses]).T, our_yaw]
        x, y, z, yaw = (np.interp(seen, stamps, column) for column in columns)
        theirs = np.array([o.position for o in lately])[use]
        their_yaw = yaw_pitch_roll(np.array([o.attitude for o in lately])[use])[:, 0]
        turn = float(np.angle(np.exp(1j * (yaw - their_yaw)).sum()))
        ours = np.median(np.stack([x, y, z], axis=1), axis=0)
        return ours, np.median(theirs, axis=0), turn

    # --- The proof of the axes --------------------------------------------------------------

    def _judge_motion(self) -> None:
        """Judge a motion by hand once a second; what shows a mistake refutes the proof."""
        if self.flying:
            self.motion.forget()
        elif self.now_ns - self._judged_ns >= _WINDOW_NS:
            self._judged_ns = self.now_ns
            self.motion.compare(self.now_ns)
        verdict = self.motion.verdict
        if verdict is not None and verdict.mistake and verdict.sure and self.evidence is not None:
            self.refute(verdict.mistake, self.now_ns)

    def _keep_proof(self) -> None:
        """Keep a new proof, once the vehicle rests."""
        verdict = self.motion.verdict
        if verdict is None or not verdict.proven or verdict is self._proved or self.tilt is None:
            return
        self._proved, self.refuted = verdict, ""
        self.evidence = self._new_evidence = self._make_evidence(self.now_ns, tilt=self.tilt)

    def _make_evidence(
        self, now_ns: int, mistake: str = "", tilt: tuple[float, ...] = ()
    ) -> AxesEvidence:
        date = str(np.datetime_as_string(np.datetime64(now_ns, "ns"), unit="s", timezone="UTC"))
        kept = tuple(round(v, 4) for v in tilt)
        return AxesEvidence(date, self.params.tracked_body, self.vehicle, mistake, kept)


_SENSORS = ("gyro", "accel")
_Evidence = Callable[[Preflight], str]


class Check(NamedTuple):
    """A question of the checklist.

    Attributes:
        key: of its finding.
        question: that must be answered with yes.
        evidence: returns the message, if the answer is no.
        weight: of the finding.
        unless: keys of earlier findings that explain it: then it is not asked.
    """

    key: str
    question: str
    evidence: _Evidence
    weight: FindingSeverity
    unless: tuple[str, ...]


CHECKS: list[Check] = []
"""The questions, in the order of this file: parameters, poses, time, what PX4 makes of the poses,
axes."""


def check(
    key: str, question: str, weight: FindingSeverity = _BLOCKS, unless: tuple[str, ...] = ()
) -> Callable[[_Evidence], _Evidence]:
    """Add the question that the decorated evidence answers."""

    def add(evidence: _Evidence) -> _Evidence:
        CHECKS.append(Check(key, question, evidence, weight, unless))
        return evidence

    return add


# --- Poses ---------------------------------------------------------------------------------------


@check("parameters_not_set", "did PX4 take what it was told?")
def _(lab: Preflight) -> str:
    pairs = ", ".join(f"{name}={value:g}" for name, value in lab.unwritten.items())
    told = f"PX4 did not take: {pairs}; is the name right, the value within its bounds?"
    return told if pairs else ""


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


def _show_refusal(why: PoseRefusal, lab: Preflight) -> str:
    age_s = lab.refused.get(why, math.nan)
    text = _REFUSED[why].format(age=age_s, ahead=-age_s, limit=lab.params.pose_age_max)
    return text if why in lab.refused else ""


for _why in _REFUSED:
    check(f"pose_{_why.key}", "can each pose be used?")(partial(_show_refusal, _why))


@check("pose_stale", "do poses come?")
def _(lab: Preflight) -> str:
    silence = f" for {(lab.now_ns - lab.last_ns) * 1e-9:.1f} s" if lab.last_ns else ""
    text = (
        f"no mocap pose has come{silence}: is the driver running, is the body tracked, is the"
        " topic /mocap/pose?"
    )
    return "" if lab.fresh or lab.refused else text


@check("pose_frozen", "do their bits change?", _WARNING)
def _(lab: Preflight) -> str:
    poses, felt = lab.poses, lab.felt
    if lab.flying or len(lab.places) == 0:
        return ""
    trembles = felt is None or (
        felt[0].std(axis=0).max() > _STILL_GYRO or felt[1].std(axis=0).max() > _STILL_ACCEL
    )
    long = poses[-1].arrival_ns - poses[0].arrival_ns >= _FROZEN_NS
    changes = np.ptp(lab.places, axis=0).any() or np.ptp([p.attitude for p in poses], 0).any()
    text = (
        "mocap pose is frozen: not one bit has changed for a second; the tracker repeats its last"
        " pose, the body is not seen (or it is simulated, without noise)"
    )
    return text if long and trembles and not changes else ""


@check("pose_bodies", "are they of one body?")
def _(lab: Preflight) -> str:
    apart = bodies_apart(lab.places) if len(lab.places) else 0.0
    text = (
        f"mocap poses of two bodies or more take turns in one topic, {apart:.2f} m apart: give"
        " each body a topic of its own"
    )
    return text if apart > 0.0 else ""


@check("pose_moves", "do they rest with the vehicle, in metres?", unless=("pose_bodies",))
def _(lab: Preflight) -> str:
    at_rest = not lab.flying and len(lab.places) > 0 and lab.at_rest
    spread = float(lab.places.std(axis=0).max()) if at_rest else 0.0
    text = (
        f"mocap poses move by {spread:.2g} m (standard deviation) while PX4's sensors are at rest:"
        " another body is tracked, or poses are in millimetres"
    )
    return text if spread > _LARGEST_NOISE_M else ""


@check("pose_rate", "do they come often enough?", _WARNING)
def _(lab: Preflight) -> str:
    slow = lab.fresh and lab.known_s > 1.0 and len(lab.poses) < _SLOWEST_HZ
    text = f"mocap poses come at {len(lab.poses)} Hz: EKF2 wants {_SLOWEST_HZ:.0f} Hz and more"
    return text if slow else ""


# --- Time ----------------------------------------------------------------------------------------


@check("timesync", "are the clocks compared?")
def _(lab: Preflight) -> str:
    text = (
        "TIMESYNC has not converged: PX4's answers are missing or too few; stamps can't be"
        " compared. Does the link work both ways?"
    )
    return "" if lab.sync.converged else text


@check("timesync_unasked", "does PX4 use it?", _WARNING, ("timesync",))
def _(lab: Preflight) -> str:
    text = (
        "PX4 has not asked for our time (TIMESYNC): it takes the arrival of poses for their"
        " capture; enable TIMESYNC on its link (MAV_0_MODE onboard)"
    )
    return "" if lab.answered or lab.now_ns - lab.linked_ns <= _REQUESTS_NS else text


# --- PX4's parameters and its use of the poses ---------------------------------------------------


@check("loss_parameters", "does a loss end on the ground?")
def _(lab: Preflight) -> str:
    wrong = explain_parameters(lab.values, _BLOCKS)
    text = (
        f"a loss in flight would not end on the ground: {wrong}. With your consent the bridge sets"
        " them: --bridge px4_parameters=safe"
    )
    return text if wrong else ""


@check("mocap_parameters", "is mocap alone fused?", _WARNING)
def _(lab: Preflight) -> str:
    wrong = explain_parameters(lab.values, _WARNING)
    text = f"{wrong}; --bridge px4_parameters=mocap sets all of them but EKF2_EV_DELAY"
    return text if wrong else ""


@check("link_parameters", "can it be armed by this link alone?", _ADVICE)
def _(lab: Preflight) -> str:
    return explain_parameters(lab.values, _ADVICE)


@check("not_fused", "does PX4 fuse the poses?")
def _(lab: Preflight) -> str:
    control, told = int(lab.values.get(EV_CTRL, FUSED)), lab.told
    if not control & 1:
        return f"position is not fused: EKF2_EV_CTRL is {control}, without bit 0; set it to 11"
    text = (
        "PX4 knows no position though poses are sent: nothing is fused; EKF2_EV_CTRL, stamps, or"
        " poses that jump"
    )
    known = told is None or not lab.poses or (told.is_aided and told.has_position)
    return "" if known else text


@check("poses_refused", "do they pass its gate?")
def _(lab: Preflight) -> str:
    told = lab.told
    # NaN where no source is fused; max() of it depends on the order
    ratios = () if told is None else (told.position_ratio, told.height_ratio)
    ratio = max((r for r in ratios if r > 1.0), default=0.0)
    text = (
        f"PX4 refuses the poses: innovation test ratio {ratio:.1f}, accepted below 1; its estimate"
        " is elsewhere: axes, stamps, or restart it"
    )
    return text if ratio > 0.0 else ""


@check("no_position", "does it send its position?")
def _(lab: Preflight) -> str:
    last_ns = lab.odometry[-1].arrival_ns if lab.odometry else 0
    text = "PX4 sends no position (ODOMETRY): it has no estimate, or the link is too slow"
    return "" if lab.now_ns - last_ns <= _ODOMETRY_SILENT_NS else text


@check("position_differs", "is it there?", unless=("no_position",))
def _(lab: Preflight) -> str:
    if lab.pairs is None:
        return ""
    ours, theirs, _ = lab.pairs
    off, limit = math.dist(ours, theirs), _POSITION_OFF_M * (_IN_FLIGHT if lab.flying else 1.0)
    text = (
        f"PX4's position is {off:.2f} m away from the pose: pose ({_place(ours)}), PX4"
        f" ({_place(theirs)}); are the poses fused (EKF2_EV_CTRL 11, EKF2_HGT_REF 3), does another"
        " sensor, or another sender with other axes, feed PX4?"
    )
    return text if off > limit else ""


def _place(position: Array) -> str:
    return ", ".join(f"{p:.2f}" for p in position)


@check("yaw_differs", "does it point there?", unless=("no_position",))
def _(lab: Preflight) -> str:
    turn = 0.0 if lab.pairs is None else lab.pairs[2]
    text = (
        f"yaw of mocap body differs from PX4 by {math.degrees(turn):+.0f} deg: x of the rigid body"
        " is not the nose, or PX4's heading comes from the magnetometer (EKF2_EV_CTRL bit 3)"
    )
    return text if abs(turn) > _YAW_OFF_RAD else ""


# --- Axes ----------------------------------------------------------------------------------------


@check("no_imu", "does it send its sensors?")
def _(lab: Preflight) -> str:
    text = "PX4 sends no HIGHRES_IMU: which way is up can't be checked"
    return "" if lab.flying or lab.felt is not None else text


@check("moved", "does the vehicle stand?", _WARNING)
def _(lab: Preflight) -> str:
    if lab.flying or lab.felt is None or not lab.poses:
        return ""
    gyro, accel = (float(np.linalg.norm(v.mean(axis=0))) for v in lab.felt)
    moved = gyro > _NO_TURN or abs(accel - GRAVITY) > _NO_PUSH
    return "the vehicle is moved: put it down" if moved else ""


@check("mocap_up", "does +z of the poses point up?", unless=("moved",))
def _(lab: Preflight) -> str:
    """Compare +z of the pose with gravity, unless a motion by hand says what is wrong."""
    verdict = lab.motion.verdict
    named = verdict is not None and verdict.mistake and verdict.sure
    if lab.flying or lab.felt is None or not lab.poses or named:
        return ""
    up = rotate_vector(lab.poses[-1].attitude, _direction(lab.felt[1].mean(axis=0)))
    error = math.acos(min(max(float(up[2]), -1.0), 1.0))
    text = (
        f"by its pose the vehicle at rest is tilted by {math.degrees(error):.0f} deg: either the"
        " quaternion is w first (let the driver fill x, y, z, w); or the pose is Y-up (set the"
        " streamed up axis to Z; OptiTrack Motive: Streaming, Up Axis); or it is one of a z-down"
        " body (NED, FRD: send ENU and FLU); or the body was defined tilted (define it again with"
        " the vehicle level and its nose along +x); turn and carry it by hand, which tells them"
        " apart"
    )
    return text if error > _TILT_OFF_RAD else ""


def _direction(vector: Array) -> Array:
    unit: Array = vector / float(np.linalg.norm(vector))
    return unit


@check("mocap_axes", "did a motion by hand agree?")
def _(lab: Preflight) -> str:
    return "" if lab.motion.verdict is None else lab.motion.verdict.mistake


@check("axes_unproven", "has it proven the axes?")
def _(lab: Preflight) -> str:
    proof, verdict = lab.evidence, lab.motion.verdict
    simulated = lab.params.axes_evidence == SIMULATED and not lab.refuted
    off = 0.0 if proof is None or lab.tilt is None else math.dist(proof.tilt_rad, lab.tilt)
    if lab.flying or simulated or (proof is not None and off <= _OTHER_BODY_RAD):
        return ""
    because = f" ({lab.refuted})" if lab.refuted else ""
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


@check("stamp_delay", "did its stamps agree?", _WARNING, ("mocap_axes",))
def _(lab: Preflight) -> str:
    verdict, told_ms = lab.motion.verdict, lab.values.get(EV_DELAY, 0.0)
    delay_ms = math.nan if verdict is None else 1e3 * verdict.delay_s
    text = (
        f"poses show the vehicle as it was {delay_ms:.0f} ms before their stamps (gyro compared),"
        f" EKF2_EV_DELAY is {told_ms:.0f} ms: let the driver stamp the capture, or set it to"
        f" {max(delay_ms, 0.0):.0f}"
    )
    return text if abs(delay_ms - told_ms) > _DELAY_OFF_MS else ""  # NaN without such a motion
