"""The checklist: each check is a question, when it is asked, its evidence and its message.

PX4 reports nothing about wrong axes, wrong stamps and poses that it does not fuse. So each
evidence looks at the samples of the last second, at PX4's parameters, or at the motion since the
arming. The message names fault, cause and remedy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Flag, auto
from functools import partial
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.rotation import rotate_vector, up_in_body, yaw_pitch_roll
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.axes_proof import (
    CARRY_M,
    HAND_NS,
    TURN_RAD,
    TURNING,
    AxesEvidence,
    HandVerdict,
    judge_hand_motion,
    valid_proof,
)
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.bridge.flight_motion import COHERENT, DECIDES_S, FlightMotion
from tombo_px4.bridge.pose_motion import IMU, POSE, Samples
from tombo_px4.bridge.vehicle_parameters import EV_CTRL, EV_DELAY, FUSED, explain_parameters
from tombo_px4.link.messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.timesync import TimeSync

_WINDOW_NS = SECOND_NS
_LEAST_SAMPLES = 8
_HAND_POSES = 3000
"""Most poses of a motion by hand that are compared."""


class CheckLimits(NamedTuple):
    """Thresholds of the checks."""

    silent_ns: int = 200_000_000  # longest time without a pose
    slowest_hz: float = 20.0  # of the poses; EKF2 wants 20 Hz
    rest_rate: float = 0.3  # [rad/s], a vehicle that stands turns slower
    rest_force: float = 0.5  # [m/s^2], standard deviation of its specific force
    still_rate: float = 1e-4  # [rad/s], standard deviation: only a simulated gyro is as quiet
    frozen_ns: int = 800_000_000  # the bits of a pose don't change for longer
    position_off_m: float = 0.2  # of PX4's position from the pose: two EKF2_EVP_NOISE
    in_flight: float = 5.0  # factor on this distance in flight
    angle_off: float = math.radians(10.0)  # of yaw and up; rigid bodies are defined by eye
    odometry_silent_ns: int = 500_000_000  # longest time without ODOMETRY
    estimator_silent_ns: int = 5 * SECOND_NS  # longest time without ESTIMATOR_STATUS
    gap_ns: int = 100_000_000  # between two poses further apart none is interpolated
    delay_off_ms: float = 20.0  # of the measured delay from EKF2_EV_DELAY
    other_body: float = 0.035  # [rad], tilt of a body at rest tells it from another one: 2 deg
    noise_m: float = 0.02  # poses of a vehicle at rest have less noise
    requests_ns: int = 3 * SECOND_NS  # PX4 asks for our time within this
    # in hover over a real PX4 in gusts it is 0.06 m RMS away, at first at most 0.1 m
    takeoff_drift_m: float = 0.15  # from the set point while it takes off
    takeoff_repeats_s: float = 0.2  # of a repeated pose in the check at take-off
    height_off_m: float = 2.0  # barometer and poses, in 5 s: propellers and doors make 1 m
    off_m: float = 0.08  # of the second differences over 0.48 s: 1.4 m/s^2
    confirms_s: float = 0.8  # time of motion after which the axes are called right
    wrong_turn: float = math.radians(35.0)  # of the motion of the poses against PX4's
    right_turn: float = math.radians(20.0)
    # slopes of poses of another body, or scale; a pose 50 ms late has 0.7 at 3 Hz
    slope_still: float = 0.5
    slope_low: float = 0.75
    slope_high: float = 1.25
    still_share: float = 0.3  # of the squared motion: less is standing still
    after_strike_s: float = 2.0  # PX4's attitude may be wrong for so long


LIMITS = CheckLimits()


class When(Flag):
    """When a check is asked."""

    GROUND = auto()
    FLIGHT = auto()
    MOTION = auto()
    """Armed: of the motion since then."""


Values = tuple[object, ...] | None


class Check(NamedTuple):
    """A question of the checklist.

    Attributes:
        key: of its finding.
        question: that must be answered with yes.
        evidence: returns the values of the message if the answer is no, else None.
        message: fault, cause and remedy.
        when: it is asked.
        blocks: the bridge does not arm while the answer is no.
        unless: keys of earlier findings that explain it: then it is not asked.
        ends_flight: in flight the vehicle must land.
        voids_proof: axes, scale or body are wrong.
        rotated: the poses are turned or mirrored, but are this vehicle's: it brakes by them. Else
            the velocity is as if they had not been followed lately.
    """

    key: str
    question: str
    evidence: Callable[[Checklist], Values]
    message: str
    when: When = When.GROUND | When.FLIGHT
    blocks: bool = True
    unless: tuple[str, ...] = ()
    ends_flight: bool = False
    voids_proof: bool = False
    rotated: bool = False


class Finding(NamedTuple):
    """A check whose answer is no, and the message: fault, cause and remedy."""

    check: Check
    text: str


class Checklist:
    """Collects poses and telemetry, keeps the proof of the axes, asks the questions.

    Attributes:
        vehicle: hardware id of the autopilot; empty: not known yet.
        poses, imu, odometry: the newest samples.
        estimator: what PX4 said last about its estimator; the caller sets it.
        verdict: what moving the vehicle by hand has shown.
        evidence: the last proof of the axes of this body; None: there is none, or it was refuted.
        refuted: fault of the axes, until a new proof.
        motion: since the arming.
    """

    def __init__(self, params: BridgeParams, proofs: Sequence[AxesEvidence] = ()) -> None:
        """Make the checks; `proofs` are those of the tracked body."""
        self.params, self._proofs = params, proofs
        self.vehicle = ""
        self.poses, self.imu = Samples(POSE, 10_000), Samples(IMU, 10_000)
        self.odometry = Samples(POSE, 1000)
        self.motion = FlightMotion(self.poses, self.imu)
        self._refusals: dict[PoseRefusal, tuple[int, float]] = {}
        self.estimator: EstimatorStatusFlags | None = None
        self.verdict: HandVerdict | None = None
        self.evidence: AxesEvidence | None = None
        self.refuted = ""
        self._new_evidence: AxesEvidence | None = None
        self._proved: HandVerdict | None = None
        self._judged_ns = self._hand_since_ns = 0

    def refused_pose(self, why: PoseRefusal, now_ns: int, age_s: float = 0.0) -> None:
        """Record a pose that was not sent, and its age."""
        self._refusals[why] = (now_ns, age_s)

    def take_imu(
        self, sample: VehicleImu, estimate: VehicleOdometry | None, airborne: bool
    ) -> None:
        """Take a sample of PX4's sensors and its estimate of about the same time."""
        level = np.array([0.0, 0.0, 0.0, 1.0])
        attitude = level if estimate is None else estimate.attitude
        force = rotate_vector(attitude, sample.accel)
        if sample.stamp_ns is not None and self.imu.add(
            sample.stamp_ns, sample.arrival_ns, sample.gyro, sample.accel, force,
            sample.pressure_altitude, airborne,
        ):  # fmt: skip
            self.motion.feel()

    def take_odometry(self, estimate: VehicleOdometry) -> None:
        """Take PX4's estimate."""
        if estimate.stamp_ns is not None:
            content = (estimate.arrival_ns, estimate.position, estimate.attitude)
            self.odometry.add(estimate.stamp_ns, *content)

    def reset(self) -> None:
        """Forget everything: another vehicle, a restart of it, or a clock that was set."""
        for samples in (self.poses, self.imu, self.odometry, self._refusals):
            samples.clear()
        self._judged_ns = self._hand_since_ns = 0
        self.estimator = self.verdict = None

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
        self._new_evidence = self._make_evidence(now_ns, mistake, [])

    def latency_s(self, now_ns: int) -> float:
        """Return the usual time from a pose's capture to its arrival here [s]; NaN: no poses."""
        poses = self.poses.since(now_ns - _WINDOW_NS, "arrival_ns")
        ages_s = (poses["arrival_ns"] - poses["stamp_ns"]) * 1e-9
        return float(np.median(ages_s)) if len(ages_s) else math.nan

    @property
    def latest_position(self) -> Array | None:
        """Position (3) of the newest pose, map [m]; None: none has come."""
        newest = self.poses.newest
        return None if newest is None else newest["position"].copy()

    def pose_rate_hz(self, now_ns: int) -> float:
        """Return how many poses came within the last second."""
        return len(self.poses.since(now_ns - _WINDOW_NS, "arrival_ns")) / (_WINDOW_NS * 1e-9)

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
    ) -> list[Finding]:
        """Ask all questions in order; return the faults; first the ones that block arming.

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
        self._judge_hand_motion()
        self._read_samples()
        if not flying:
            self._keep_proof()
        findings = self._ask(When.FLIGHT if flying else When.GROUND)
        return sorted(findings, key=lambda finding: not finding.check.blocks)

    def motion_findings(
        self, drift_m: float, checks_takeoff: bool, silent_s: float
    ) -> list[Finding]:
        """Ask the questions of the motion since the arming.

        Args:
            drift_m: way from the set point since the arming, while it takes off [m].
            checks_takeoff: the axes have to show yet.
            silent_s: time since the last pose that was sent [s].
        """
        self.drift_m, self.checks_takeoff, self.silent_s = drift_m, checks_takeoff, silent_s
        return self._ask(When.MOTION)

    def _ask(self, when: When) -> list[Finding]:
        findings: dict[str, Finding] = {}
        for check in CHECKS:
            if check.when & when and not findings.keys() & {check.key, *check.unless}:
                values = check.evidence(self)
                if values is not None:
                    findings[check.key] = Finding(check, check.message.format(*values))
        return list(findings.values())

    # --- What the evidence looks at ---------------------------------------------------------

    def _read_samples(self) -> None:
        """Look at the last second."""
        now_ns = self.now_ns
        lately = now_ns - _WINDOW_NS
        self.recent = self.poses.since(lately, "arrival_ns")
        """Poses of the last second."""
        sensed = self.imu.since(lately, "arrival_ns")
        newest, oldest = self.poses.newest, self.poses.since(0)[:1]
        self.last_ns = 0 if newest is None else int(newest["arrival_ns"])
        self.known_s = (now_ns - int(oldest["arrival_ns"][0])) * 1e-9 if len(oldest) else 0.0
        self.fresh = now_ns - self.last_ns <= LIMITS.silent_ns
        """Poses are coming."""
        ages = self._refusals.items()
        self.refused = {why: age_s for why, (at, age_s) in ages if at >= lately}
        """Why poses were not sent, and their age [s]."""
        enough = self.fresh and len(self.recent) >= _LEAST_SAMPLES
        self.places = self.recent["position"] if enough else np.zeros((0, 3))
        """Positions (N, 3) of the poses [m]; none where they are too few, or old."""
        told = self.estimator
        silent = told is None or now_ns - told.arrival_ns > LIMITS.estimator_silent_ns
        self.told = None if silent else told
        """What PX4 has said of its estimator; None: nothing lately."""
        self.felt: tuple[Array, Array] | None = None
        """Rates and specific forces (N, 3) of PX4's sensors; None: too few."""
        self.at_rest = False
        """PX4's sensors show a vehicle that stands."""
        if len(sensed) >= _LEAST_SAMPLES:
            gyro, accel = self.felt = sensed["gyro"], sensed["accel"]
            stands = np.abs(gyro).max() < LIMITS.rest_rate
            self.at_rest = bool(stands and accel.std(axis=0).max() < LIMITS.rest_force)
        self.tilt = self._tilt_at_rest()
        self.pairs = self._pairs()

    def _tilt_at_rest(self) -> list[float] | None:
        """Return how the tracked body's z is tilted in the vehicle [rad]; None: it is moved."""
        if len(self.recent) < _LEAST_SAMPLES or self.felt is None or not self.at_rest:
            return None
        mean = up_in_body(self.recent["attitude"]).mean(axis=0)
        tilt: list[float] = (mean - _direction(self.felt[1].mean(axis=0)))[:2].tolist()
        return tilt

    def _pairs(self) -> tuple[Array, Array, float] | None:
        """Return position of the pose, that of PX4, and yaw of the pose against PX4's.

        All of the same time, medians over the last second; None without enough of both.
        """
        poses = self.recent
        theirs = self.odometry.since(self.now_ns - _WINDOW_NS, "arrival_ns")
        if min(len(poses), len(theirs)) < _LEAST_SAMPLES:
            return None
        stamps, seen = poses["stamp_ns"], theirs["stamp_ns"]
        after = np.clip(np.searchsorted(stamps, seen), 1, len(stamps) - 1)
        inside = (stamps[0] <= seen) & (seen <= stamps[-1])
        use = inside & (stamps[after] - stamps[after - 1] <= LIMITS.gap_ns)
        if use.sum() < _LEAST_SAMPLES:
            return None
        theirs = theirs[use]
        our_yaw = np.unwrap(yaw_pitch_roll(poses["attitude"])[:, 0])
        columns = [*poses["position"].T, our_yaw]
        x, y, z, yaw = (np.interp(seen[use], stamps, column) for column in columns)
        their_yaw = yaw_pitch_roll(theirs["attitude"])[:, 0]
        turn = float(np.angle(np.exp(1j * (yaw - their_yaw)).sum()))
        ours = np.median(np.stack([x, y, z], axis=1), axis=0)
        return ours, np.median(theirs["position"], axis=0), turn

    # --- The proof of the axes --------------------------------------------------------------

    def _judge_hand_motion(self) -> None:
        """Judge a motion by hand once a second; what shows a mistake refutes the proof."""
        if self.flying:
            self._hand_since_ns = self.now_ns  # a flight is not a motion by hand
        elif self.now_ns - self._judged_ns >= _WINDOW_NS:
            moved = self.imu.since(self._judged_ns)["gyro"]
            self._judged_ns = self.now_ns
            if len(moved) and np.linalg.norm(moved, axis=1).max() > TURNING:
                since_ns = max(self.now_ns - HAND_NS, self._hand_since_ns)
                poses, imu = self.poses.since(since_ns), self.imu.since(since_ns)
                poses = poses[:: len(poses) // _HAND_POSES + 1]
                verdict = judge_hand_motion(poses, imu, LIMITS.angle_off)
                self.verdict = verdict or self.verdict
        verdict = self.verdict
        if verdict is not None and verdict.mistake and verdict.sure and self.evidence is not None:
            self.refute(verdict.mistake, self.now_ns)

    def _keep_proof(self) -> None:
        """Keep a new proof, once the vehicle rests."""
        verdict = self.verdict
        if verdict is None or not verdict.proven or verdict is self._proved or self.tilt is None:
            return
        self._proved, self.refuted = verdict, ""
        self.evidence = self._new_evidence = self._make_evidence(self.now_ns, "", self.tilt)

    def _make_evidence(self, now_ns: int, mistake: str, tilt: list[float]) -> AxesEvidence:
        date = str(np.datetime_as_string(np.datetime64(now_ns, "ns"), unit="s", timezone="UTC"))
        kept = [round(v, 4) for v in tilt]
        return AxesEvidence(date, self.params.tracked_body, self.vehicle, mistake, kept)


# --- Evidence: the values of the message, None without a fault -----------------------------------


def _named(text: str) -> Values:
    return (text,) if text else None


def _when(wrong: object, *values: object) -> Values:
    return values if wrong else None


def _not_taken(lab: Checklist) -> Values:
    return _named(", ".join(f"{name}={value:g}" for name, value in lab.unwritten.items()))


def _refusal(lab: Checklist, why: PoseRefusal) -> Values:
    age_s = lab.refused.get(why, math.nan)
    return _when(why in lab.refused, age_s, -age_s, lab.params.pose_age_max)


def _silence(lab: Checklist) -> Values:
    silence = f" for {(lab.now_ns - lab.last_ns) * 1e-9:.1f} s" if lab.last_ns else ""
    return _when(not lab.fresh and not lab.refused, silence)


def _frozen(lab: Checklist) -> Values:
    poses, felt = lab.recent, lab.felt
    if len(lab.places) == 0:
        return None
    trembles = felt is None or felt[0].std(axis=0).max() > LIMITS.still_rate
    long = poses["arrival_ns"][-1] - poses["arrival_ns"][0] >= LIMITS.frozen_ns
    changes = np.ptp(lab.places, axis=0).any() or np.ptp(poses["attitude"], axis=0).any()
    return _when(long and trembles and not changes)


def _bodies(lab: Checklist) -> Values:
    apart = bodies_apart(lab.places) if len(lab.places) else 0.0
    return _when(apart > 0.0, apart)


def _moving(lab: Checklist) -> Values:
    spread = float(lab.places.std(axis=0).max()) if len(lab.places) and lab.at_rest else 0.0
    return _when(spread > LIMITS.noise_m, spread)


def _slow(lab: Checklist) -> Values:
    count = len(lab.recent)
    return _when(lab.fresh and lab.known_s > 1.0 and count < LIMITS.slowest_hz, count)


def _unasked(lab: Checklist) -> Values:
    return _when(not lab.answered and lab.now_ns - lab.linked_ns > LIMITS.requests_ns)


def _not_fused(lab: Checklist) -> Values:
    control, told = int(lab.values.get(EV_CTRL, FUSED)), lab.told
    if not control & 1:
        return (f"position is not fused: EKF2_EV_CTRL is {control}, without bit 0; set it to 11",)
    known = told is None or not len(lab.recent) or (told.is_aided and told.has_position)
    text = "PX4 knows no position though poses are sent: nothing is fused; EKF2_EV_CTRL, stamps,"
    return _when(not known, f"{text} or poses that jump")


def _gate(lab: Checklist) -> Values:
    # NaN where no source is fused; max() of it depends on the order
    ratios = () if lab.told is None else (lab.told.position_ratio, lab.told.height_ratio)
    ratio = max((r for r in ratios if r > 1.0), default=0.0)
    return _when(ratio > 0.0, ratio)


def _no_position(lab: Checklist) -> Values:
    last = lab.odometry.newest
    silent_ns = lab.now_ns - (0 if last is None else int(last["arrival_ns"]))
    return _when(silent_ns > LIMITS.odometry_silent_ns)


def _elsewhere(lab: Checklist) -> Values:
    if lab.pairs is None:
        return None
    ours, theirs, _ = lab.pairs
    off, limit = math.dist(ours, theirs), LIMITS.position_off_m
    places = (", ".join(f"{p:.2f}" for p in place) for place in (ours, theirs))
    return _when(off > limit * (LIMITS.in_flight if lab.flying else 1.0), off, *places)


def _yaw(lab: Checklist) -> Values:
    turn = 0.0 if lab.pairs is None else lab.pairs[2]
    return _when(abs(turn) > LIMITS.angle_off, math.degrees(turn))


def _up(lab: Checklist) -> Values:
    """Compare +z of the pose with gravity, unless a motion by hand says what is wrong."""
    verdict = lab.verdict
    named = verdict is not None and verdict.mistake and verdict.sure
    if lab.felt is None or not lab.at_rest or not len(lab.recent) or named:
        return None
    up = rotate_vector(lab.recent["attitude"][-1], _direction(lab.felt[1].mean(axis=0)))
    error = math.acos(min(max(float(up[2]), -1.0), 1.0))
    return _when(error > LIMITS.angle_off, math.degrees(error))


def _direction(vector: Array) -> Array:
    unit: Array = vector / float(np.linalg.norm(vector))
    return unit


def _unproven(lab: Checklist) -> Values:
    proof, verdict = lab.evidence, lab.verdict
    simulated = lab.params.axes_evidence == SIMULATED and not lab.refuted
    off = 0.0 if proof is None or lab.tilt is None else math.dist(proof.tilt_rad, lab.tilt)
    if simulated or (proof is not None and off <= LIMITS.other_body):
        return None
    because, until_now = f" ({lab.refuted})" if lab.refuted else "", ""
    if proof is not None:
        because = (
            f" (the proof of {proof.date} was of another body: it lay {math.degrees(off):.1f} deg"
            " differently in the vehicle)"
        )
    if verdict is not None:
        turned, carried = (
            ", ".join(f"{v:.1f}" for v in way) for way in (verdict.rotated, verdict.carried)
        )
        until_now = (
            f" (until now: turned {turned} rad, carried {carried} m, {verdict.least_carried:.1f} m"
            " in the direction of least motion)"
        )
    return because, until_now


def _delay(lab: Checklist) -> Values:
    told_ms = lab.values.get(EV_DELAY, 0.0)
    delay_ms = math.nan if lab.verdict is None else 1e3 * lab.verdict.delay_s
    off = abs(delay_ms - told_ms) > LIMITS.delay_off_ms  # NaN without such a motion
    return _when(off, delay_ms, told_ms, max(delay_ms, 0.0))


def _drift(lab: Checklist) -> Values:
    drifts = lab.drift_m > LIMITS.takeoff_drift_m and lab.motion.has_new_pose
    return _when(drifts and not lab.motion.confirmed, lab.drift_m)


def _repeats(lab: Checklist) -> Values:
    long = lab.checks_takeoff and lab.silent_s > LIMITS.takeoff_repeats_s
    return _when(long and PoseRefusal.REPEATED in lab.refused)


def _height(lab: Checklist) -> Values:
    return _when(abs(lab.motion.climbed_m) > LIMITS.height_off_m, lab.motion.climbed_m)


def _way(lab: Checklist) -> Values:
    off_m = lab.motion.off_m if lab.motion.confirmed else lab.motion.off_up_m
    return _when(off_m > LIMITS.off_m, off_m)


def _moves_aside(lab: Checklist) -> Values:
    level = lab.motion.level
    if lab.motion.confirmed or level.time_s < DECIDES_S:  # jumps of poses alone are not of axes
        return None
    along, mirrored = level.coherence(level.product), level.coherence(level.mirrored)
    turn = float(np.angle(level.product))
    if mirrored > max(COHERENT, 1.5 * along):
        return ("mirrored to",)
    wrong = along > COHERENT and abs(turn) > LIMITS.wrong_turn
    return _when(wrong, f"{math.degrees(turn):+.0f} deg beside")


def confirms_axes(motion: FlightMotion) -> bool:
    """Return whether level motion has shown that the axes are right."""
    level = motion.level
    long = level.time_s > LIMITS.confirms_s and level.coherence(level.product) > COHERENT
    return bool(long and abs(np.angle(level.product)) < LIMITS.right_turn)


def _size(lab: Checklist) -> Values:
    motion, sums = lab.motion, lab.motion.recent
    if motion.since_strike_s < LIMITS.after_strike_s or sums.time_s < DECIDES_S:
        return None
    most, least = sums.slope + sums.error, sums.slope - sums.error
    wrong = (most < LIMITS.slope_low or least > LIMITS.slope_high) and not motion.confirmed
    if most < LIMITS.slope_still or (wrong and sums.slope < LIMITS.still_share):
        still = sums.pose_square < LIMITS.still_share * sums.imu_square
        body = "does not move" if still else "moves otherwise"
        return (f"the tracked body {body}; is it this vehicle?",)
    return _when(wrong, f"they move {sums.slope:.1f} times as far: wrong scale, or unit")


# --- The table ----------------------------------------------------------------------------------

_REFUSED = {
    PoseRefusal.FUTURE: (
        "mocap stamps are {1:.3g} s in the future: the clock of the mocap computer is ahead;"
        " let chrony or NTP set both clocks"
    ),
    PoseRefusal.LATE: (
        "mocap stamps are {0:.3g} s old when they arrive, accepted are {2:g} s: the clock"
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
_GROUND, _MOTION = When.GROUND, When.MOTION
CHECKS = (
    Check(
        "parameters_not_set", "did PX4 take what it was told?", _not_taken,
        "PX4 did not take: {}; is the name right, the value within its bounds?",
    ),
    *(
        Check(f"pose_{why.key}", "can each pose be used?", partial(_refusal, why=why), text)
        for why, text in _REFUSED.items()
    ),
    Check(
        "pose_stale", "do poses come?", _silence,
        "no mocap pose has come{}: is the driver running, is the body tracked, is the topic"
        " /mocap/pose?",
    ),
    Check(
        "pose_frozen", "do their bits change?", _frozen,
        "mocap pose is frozen: not one bit has changed for a second; the tracker repeats its last"
        " pose, the body is not seen (or it is simulated, without noise)",
        _GROUND, blocks=False,
    ),
    Check(
        "pose_bodies", "are they of one body?", _bodies,
        "mocap poses of two bodies or more take turns in one topic, {:.2f} m apart: give each body"
        " a topic of its own",
    ),
    Check(
        "pose_moves", "do they rest with the vehicle, in metres?", _moving,
        "mocap poses move by {:.2g} m (standard deviation) while PX4's sensors are at rest:"
        " another body is tracked, or poses are in millimetres",
        _GROUND, unless=("pose_bodies",),
    ),
    Check(
        "pose_rate", "do they come often enough?", _slow,
        "mocap poses come at {} Hz: EKF2 wants 20 Hz and more", blocks=False,
    ),
    Check(
        "timesync", "are the clocks compared?", lambda lab: _when(not lab.sync.converged),
        "TIMESYNC has not converged: PX4's answers are missing or too few; stamps can't be"
        " compared. Does the link work both ways?",
    ),
    Check(
        "timesync_unasked", "does PX4 use it?", _unasked,
        "PX4 has not asked for our time (TIMESYNC): it takes the arrival of poses for their"
        " capture; enable TIMESYNC on its link (MAV_0_MODE onboard)",
        blocks=False, unless=("timesync",),
    ),
    Check(
        "loss_parameters", "does a loss end on the ground?",
        lambda lab: _named(explain_parameters(lab.values, blocks=True)),
        "a loss in flight would not end on the ground: {}. With your consent the bridge sets"
        " them: --bridge px4_parameters=safe",
    ),
    Check(
        "mocap_parameters", "is mocap alone fused?",
        lambda lab: _named(explain_parameters(lab.values, blocks=False)),
        "{}; --bridge px4_parameters=mocap sets all of them but EKF2_EV_DELAY", blocks=False,
    ),
    Check("not_fused", "does PX4 fuse the poses?", _not_fused, "{}", ends_flight=True),
    Check(
        "poses_refused", "do they pass its gate?", _gate,
        "PX4 refuses the poses: innovation test ratio {:.1f}, accepted below 1; its estimate is"
        " elsewhere: axes, stamps, or restart it",
        ends_flight=True,
    ),
    Check(
        "no_position", "does it send its position?", _no_position,
        "PX4 sends no position (ODOMETRY): it has no estimate, or the link is too slow",
        unless=("timesync",), ends_flight=True,
    ),
    Check(
        "position_differs", "is it there?", _elsewhere,
        "PX4's position is {:.2f} m away from the pose: pose ({}), PX4 ({}); are the poses fused"
        " (EKF2_EV_CTRL 11, EKF2_HGT_REF 3), does another sensor, or another sender with other"
        " axes, feed PX4?",
        unless=("no_position",), ends_flight=True,
    ),
    Check(
        "yaw_differs", "does it point there?", _yaw,
        "yaw of mocap body differs from PX4 by {:+.0f} deg: x of the rigid body is not the nose,"
        " or PX4's heading comes from the magnetometer (EKF2_EV_CTRL bit 3)",
        unless=("no_position",), ends_flight=True,
    ),
    Check(
        "no_imu", "does it send its sensors?", lambda lab: _when(lab.felt is None),
        "PX4 sends no HIGHRES_IMU: which way is up can't be checked",
        _GROUND, unless=("timesync",),
    ),
    Check(
        "mocap_up", "does +z of the poses point up?", _up,
        "by its pose the vehicle at rest is tilted by {:.0f} deg: either the quaternion is w first"
        " (let the driver fill x, y, z, w); or the pose is Y-up (set the streamed up axis to Z;"
        " OptiTrack Motive: Streaming, Up Axis); or it is one of a z-down body (NED, FRD: send ENU"
        " and FLU); or the body was defined tilted (define it again with the vehicle level and its"
        " nose along +x); turn and carry it by hand, which tells them apart",
        _GROUND,
    ),
    Check(
        "mocap_axes", "did a motion by hand agree?",
        lambda lab: _named(lab.verdict.mistake if lab.verdict else ""), "{}",
    ),
    Check(
        "axes_unproven", "has it proven the axes?", _unproven,
        "the axes of the poses are not proven{}: propellers off, turn the vehicle by hand about"
        f" each axis, {TURN_RAD:g} rad in all, and carry it briskly, {CARRY_M:g} m in all along"
        " each axis, within 40 s; then put it down{}",
        _GROUND,
    ),
    Check(
        "stamp_delay", "did its stamps agree?", _delay,
        "poses show the vehicle as it was {:.0f} ms before their stamps (gyro compared),"
        " EKF2_EV_DELAY is {:.0f} ms: let the driver stamp the capture, or set it to {:.0f}",
        blocks=False, unless=("mocap_axes",),
    ),
    Check(
        "takeoff_drift", "does it hold its place while it takes off?", _drift,
        "the vehicle is {:.2f} m beside its set point while it takes off: PX4 does not hold it;"
        " axes of the poses, or a wind that is too strong",
        _MOTION, rotated=True,
    ),
    Check(
        "takeoff_repeats", "do poses change while it takes off?", _repeats,
        _REFUSED[PoseRefusal.REPEATED], _MOTION,
    ),
    Check(
        "height_differs", "does the barometer climb with the poses?", _height,
        "within 5 s PX4's barometer has moved {:+.1f} m against the height of the poses: the"
        " tracked body is not this vehicle",
        _MOTION,
    ),
    Check(
        "moves_aside", "do the poses move where PX4 drives the vehicle?", _moves_aside,
        "poses move {} where PX4's tilt drives the vehicle: x of the rigid body is not the nose,"
        " or the axes of the positions are not those of the attitude, or left-handed",
        _MOTION, voids_proof=True, rotated=True,
    ),
    Check(
        "moves_otherwise", "do the poses move as far as the vehicle?", _size,
        "poses do not show the motion that PX4's accelerometer measures: {}",
        _MOTION, voids_proof=True,
    ),
    Check(
        "way_differs", "do the poses move as the accelerometer does now?", _way,
        "within 0.5 s the poses moved {:.2f} m less or more than PX4's accelerometer measures: is"
        " the tracked body this vehicle?",
        _MOTION,
    ),
)  # fmt: skip
"""The questions: poses, time, what PX4 makes of the poses, axes, motion in flight."""
