"""Honest damage to a real log, and whether the diagnosis names it.

Each mutation is what a logger, a mapping or a mechanic may do to a sound flight. The answers are
those of the three ways to ask: of the log alone, with a vehicle file of other flights, and against
healthy flights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Finding, Flight, RefusedLog, Series
from tombo_diagnosis.change.diagnose import diagnose_change_unchecked
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose import diagnose_unchecked
from tombo_diagnosis.flight.nominal import held_against, nominal_model
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.page import Cell, Page, Section, Table
from tombo_flight.vehicle_file import VehicleFile

SEED = 20261128
POSE, IMU = ("position", "attitude"), ("gyro", "accel")
ROTORS = ("rotor_speed", "rotor_command", "motor_command")
_COMPARED = ("position", "gyro")
"""Stamps and frames of poses and IMU: a difference can be a fault of either."""
_LIGHTER = "mass_error thrust_coefficient_error"
_ONE_ROTOR = "weak_propeller added_weight cog_offset thrust_scatter"

Change = Callable[[Series, np.random.Generator], Series]
"""A series, and a generator that starts the same for each channel, to the damaged series."""


@dataclass(frozen=True)
class Mutation:
    """One kind of damage."""

    name: str
    channels: tuple[str, ...]
    """Channels that it changes."""
    change: Change
    checks: str
    """Checks whose finding names it, with spaces between them."""
    effects: str = ""
    """Effects of the registry that describe it: to name one of them is right, too."""

    def applied(self, log: Flight, seed: Sequence[int]) -> Flight:
        """Return the log with this damage."""
        changed = {
            name: self.change(log.series[name], np.random.default_rng(seed))
            for name in self.channels
            if name in log.series
        }
        return log.with_series({**log.series, **changed})

    def named_by(self, findings: Sequence[Finding]) -> bool:
        """Return whether one of these findings names the damage, with its channel."""
        return any(
            f.severity != "info" and f.check in self.checks.split() and self.concerns(f.channel)
            for f in findings
        )

    def named_by_error(self, error: InputError) -> bool:
        """Return whether checks refuse the flight by a channel that it concerns."""
        return isinstance(error, RefusedLog) and self.concerns(error.finding.channel)

    def concerns(self, channel: str) -> bool:
        """Return whether the channel is changed, or compared with one that is."""
        return any(
            channel in kin
            for kin in (POSE, IMU, ROTORS, _COMPARED)
            if set(kin) & set(self.channels)
        )


def _of_values(change: Callable[[Array], Array]) -> Change:
    return lambda series, rng: replace(series, values=change(series.values))


def _scaled(factor: Any) -> Change:
    return _of_values(lambda values: values * factor)


def _plus(offset: Sequence[float]) -> Change:
    return _of_values(lambda values: values + np.array(offset))


def _mixed(order: Sequence[int], signs: Sequence[float] = (1,)) -> Change:
    """Change the order of the columns, and their signs."""
    return _of_values(lambda values: values[:, list(order)] * np.array(signs))


def _yawed(degrees: float) -> Change:
    turn = Rotation.from_euler("z", degrees, degrees=True)
    return _of_values(lambda q: np.asarray((Rotation.from_quat(q) * turn).as_quat()))


def _late(seconds: float) -> Change:
    return lambda series, rng: replace(series, t=series.t + seconds, arrival=None)


def _frozen(seconds: float) -> Change:
    def change(series: Series, rng: np.random.Generator) -> Series:
        begin = float(rng.uniform(6.0, 12.0))
        rows = np.arange(series.t.size)
        held = (series.t > begin) & (series.t < begin + seconds)
        rows[held] = np.argmax(held)
        return replace(series, values=series.values[rows])

    return change


def _dropped(share: float) -> Change:
    def change(series: Series, rng: np.random.Generator) -> Series:
        kept = rng.random(series.t.size) > share
        return Series(series.t[kept], series.values[kept])

    return change


MUTATIONS: tuple[Mutation, ...] = (
    Mutation("position: x and y swapped", POSE[:1], _mixed([1, 0, 2]), "frame refused"),
    Mutation("position: y reversed", POSE[:1], _mixed([0, 1, 2], [1, -1, 1]), "frame refused"),
    Mutation("position: x scaled by 1.3", POSE[:1], _scaled([1.3, 1.0, 1.0]), "scale unit"),
    Mutation("position: m as mm", POSE[:1], _scaled(1000.0), "unit refused"),
    Mutation(
        "attitude: body yawed by 20 deg", POSE[1:], _yawed(20.0), "frame",
        "mocap_body_misalignment imu_misalignment",
    ),
    Mutation("gyro: x and y swapped", IMU[:1], _mixed([1, 0, 2]), "frame"),
    Mutation("gyro: y reversed", IMU[:1], _mixed([0, 1, 2], [1, -1, 1]), "frame"),
    Mutation("gyro: x scaled by 1.5", IMU[:1], _scaled([1.5, 1.0, 1.0]), "scale unit"),
    Mutation(
        "gyro: y with an offset of 0.3 rad/s", IMU[:1], _plus([0.0, 0.3, 0.0]), "offset",
        "imu_bias",
    ),
    Mutation("gyro: rad/s as deg/s", IMU[:1], _scaled(np.degrees(1.0)), "unit"),
    Mutation("accel: x and z swapped", IMU[1:], _mixed([2, 1, 0]), "frame"),
    Mutation("accel: x reversed", IMU[1:], _mixed([0, 1, 2], [-1, 1, 1]), "frame"),
    Mutation(
        "accel: z scaled by 1.15", IMU[1:], _scaled([1.0, 1.0, 1.15]), "scale unit offset",
        "accel_scale imu_bias",
    ),
    Mutation(
        "accel: x with an offset of 1 m/s^2", IMU[1:], _plus([1.0, 0.0, 0.0]), "offset",
        "imu_bias imu_misalignment mocap_body_misalignment",
    ),
    Mutation("accel: m/s^2 as g", IMU[1:], _scaled(GRAVITY), "unit"),
    Mutation("motors: two swapped", ROTORS, _mixed([1, 0, 2, 3]), "rpm"),
    Mutation(
        "motors: one command scaled by 0.8", ROTORS, _scaled([1.0, 0.8, 1.0, 1.0]), "rpm scale",
        _ONE_ROTOR,
    ),
    Mutation("motors: all commands scaled by 0.8", ROTORS, _scaled(0.8), "scale", _LIGHTER),
    Mutation("motors: late by 0.15 s", ROTORS, _late(0.15), "stamps", "command_delay"),
    Mutation(
        "IMU: late by 60 ms", IMU, _late(0.06), "stamps", "mocap_stamp_error mocap_latency"
    ),
    Mutation("poses: frozen for 1 s", POSE, _frozen(1.0), "frozen"),
    Mutation(
        "poses: a fifth of the samples dropped", POSE, _dropped(0.2), "gap", "mocap_dropouts"
    ),
)  # fmt: skip
"""One log can't show that all commands are scaled: no other channel in it says
which thrust a command gives."""


@dataclass(frozen=True)
class Answer:
    """The answer of one way to one mutation."""

    mutation: str
    way: str
    named: bool
    text: str
    """The finding or the cause that names it; else the verdict."""


Way = Callable[[Flight], Diagnosis]
"""How `tombo diagnose` is asked."""


def ask_all(
    log: Flight,
    vehicle: VehicleFile | None,
    healthy: Sequence[Flight],
    progress: ProgressCallback = no_progress,
) -> list[Answer]:
    """Return the answers about a log (as read) with each mutation, in each way that can be asked.

    Findings and causes in the sound log do not count.

    Args:
        log: a sound one.
        vehicle: of other healthy flights of the vehicle; None: not asked with it.
        healthy: flights to compare with, as read; none: not asked with them.
        progress: called with the mutation and the share done.
    """
    ways: dict[str, Way] = {"plain": lambda log: diagnose_unchecked([log], nominal_model())[0]}
    if vehicle is not None:
        nominal = nominal_model(vehicle=vehicle)
        ways["vehicle"] = lambda log: diagnose_unchecked(held_against([log], vehicle), nominal)[0]
    if healthy:
        ways["healthy"] = lambda log: diagnose_change_unchecked([log], healthy)[0]
    answers = []
    for i, (name, way) in enumerate(ways.items()):
        sound = _answers_about(way(log), log.name)
        for k, mutation in enumerate(MUTATIONS):
            progress(f"{name}: {mutation.name}", (i + k / len(MUTATIONS)) / len(ways))
            named, text = _answer(mutation, way, mutation.applied(log, (SEED, k)), sound)
            answers.append(Answer(mutation.name, name, named, text))
    return answers


def _answer(mutation: Mutation, way: Way, log: Flight, sound: set[str]) -> tuple[bool, str]:
    """Return whether the mutation is named, and the words of that."""
    try:
        diagnosis = way(log)
    except InputError as error:
        return mutation.named_by_error(error), str(error)
    findings = [
        f
        for f in diagnosis.prechecks
        if f.flight == log.name and _place(f) not in sound and mutation.named_by([f])
    ]
    new = [name for name in _effects(diagnosis) if name not in sound]
    causes = [name for name in new if name.split(".")[0] in mutation.effects.split()]
    text = findings[0].message if findings else f"{diagnosis.verdict}: {', '.join(new)}"
    return bool(findings or causes), text


def _answers_about(diagnosis: Diagnosis, flight: str) -> set[str]:
    places = {
        _place(f) for f in diagnosis.prechecks if f.flight == flight and f.severity != "info"
    }
    return places | {*_effects(diagnosis)}


def _effects(diagnosis: Diagnosis) -> list[str]:
    causes = [c.effect for c in diagnosis.causes]
    changed = [c.effect for c in diagnosis.changed]
    return list(dict.fromkeys([*causes, *changed, *diagnosis.set]))


def _place(finding: Finding) -> str:
    return f"{finding.check} {finding.channel}"


def mutation_page(flight: str, answers: Sequence[Answer]) -> Page:
    """Return a page about the answers of `ask_all`."""
    ways = list(dict.fromkeys(a.way for a in answers))
    named = {way: sum(a.named for a in answers if a.way == way) for way in ways}
    counts = "; ".join(f"{way} {named[way]} of {len(MUTATIONS)}" for way in ways)
    sections = [
        Section(
            way,
            [
                Table(
                    ("what was done", "named", "what is said"),
                    [
                        (a.mutation, Cell("yes" if a.named else "no", "" if a.named else "bad"),
                         Cell(a.text, "muted"))
                        for a in answers
                        if a.way == way
                    ],
                )
            ],
        )
        for way in ways
    ]  # fmt: skip
    return Page(
        title=flight,
        eyebrow="mutations of a log",
        headline=f"Named: {counts}",
        summary="",
        sections=sections,
        data={"flight": flight, "named": named, "answers": [asdict(a) for a in answers]},
    )
