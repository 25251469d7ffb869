"""Honest damage to a real log, and whether the diagnosis names it.

Each mutation is what a logger, a mapping or a mechanic may do to a sound flight. The answers are
those of the three ways to ask: of the log alone, with a vehicle file of other flights, and against
healthy flights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Finding, Flight, Series
from tombo_benchmarks.diagnosis.log_faults import (
    IMU,
    MIXED,
    POSE,
    ROTORS,
    SCALED,
    LogFault,
    columns,
    frozen,
    log_fault,
    of_stamps,
    of_values,
)
from tombo_benchmarks.diagnosis.ways import against_healthy, diagnosed
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.nominal import held_against, nominal_model
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.page import Cell, Page, Section, Table
from tombo_flight.vehicle_file import VehicleFile

SEED = 20261128
_LIGHTER = "mass_error thrust_coefficient_error"
_ONE_ROTOR = "weak_propeller added_weight cog_offset thrust_scatter"


def _dropped(series: Series, share: float, rng: np.random.Generator) -> Series:
    kept = rng.random(series.t.size) > share
    return Series(series.t[kept], series.values[kept])


def _yawed(q: Array, degrees: float) -> Array:
    turn = Rotation.from_euler("z", degrees, degrees=True)
    return np.asarray((Rotation.from_quat(q) * turn).as_quat())


_PLUS = of_values(lambda values, offset: values + offset)
_LATE = of_stamps(lambda t, seconds: t + seconds)

MUTATIONS: tuple[LogFault, ...] = (
    log_fault(
        "position: x and y swapped", POSE[:1], columns([1, 0, 2], [1]), MIXED, "frame refused"
    ),
    log_fault(
        "position: y reversed", POSE[:1], columns([0, 1, 2], [1, -1, 1]), MIXED,
        "frame refused",
    ),
    log_fault(
        "position: x scaled by 1.3", POSE[:1], np.array([1.3, 1.0, 1.0]), SCALED, "scale unit"
    ),
    log_fault("position: m as mm", POSE[:1], 1000.0, SCALED, "unit refused"),
    log_fault(
        "attitude: body yawed by 20 deg", POSE[1:], 20.0, of_values(_yawed), "frame",
        "mocap_body_misalignment imu_misalignment",
    ),
    log_fault("gyro: x and y swapped", IMU[:1], columns([1, 0, 2], [1]), MIXED, "frame"),
    log_fault(
        "gyro: y reversed", IMU[:1], columns([0, 1, 2], [1, -1, 1]), MIXED, "frame"
    ),
    log_fault(
        "gyro: x scaled by 1.5", IMU[:1], np.array([1.5, 1.0, 1.0]), SCALED, "scale unit"
    ),
    log_fault(
        "gyro: y with an offset of 0.3 rad/s", IMU[:1], np.array([0.0, 0.3, 0.0]), _PLUS,
        "offset", "imu_bias",
    ),
    log_fault("gyro: rad/s as deg/s", IMU[:1], np.degrees(1.0), SCALED, "unit"),
    log_fault(
        "accel: x and z swapped", IMU[1:], columns([2, 1, 0], [1]), MIXED, "frame"
    ),
    log_fault(
        "accel: x reversed", IMU[1:], columns([0, 1, 2], [-1, 1, 1]), MIXED, "frame"
    ),
    log_fault(
        "accel: z scaled by 1.15", IMU[1:], np.array([1.0, 1.0, 1.15]), SCALED,
        "scale unit offset", "accel_scale imu_bias",
    ),
    log_fault(
        "accel: x with an offset of 1 m/s^2", IMU[1:], np.array([1.0, 0.0, 0.0]), _PLUS,
        "offset", "imu_bias imu_misalignment mocap_body_misalignment",
    ),
    log_fault("accel: m/s^2 as g", IMU[1:], GRAVITY, SCALED, "unit"),
    log_fault(
        "motors: two swapped", ROTORS, columns([1, 0, 2, 3], [1]), MIXED, "rpm"
    ),
    log_fault(
        "motors: one command scaled by 0.8", ROTORS, np.array([1.0, 0.8, 1.0, 1.0]), SCALED,
        "rpm scale", _ONE_ROTOR,
    ),
    log_fault("motors: all commands scaled by 0.8", ROTORS, 0.8, SCALED, "scale", _LIGHTER),
    log_fault("motors: late by 0.15 s", ROTORS, 0.15, _LATE, "stamps", "command_delay"),
    log_fault(
        "IMU: late by 60 ms", IMU, 0.06, _LATE, "stamps", "mocap_stamp_error mocap_latency"
    ),
    log_fault("poses: frozen for 1 s", POSE, 1.0, frozen, "frozen"),
    log_fault(
        "poses: a fifth of the samples dropped", POSE, 0.2, _dropped, "gap", "mocap_dropouts"
    ),
)  # fmt: skip
"""One log can't show that all commands are scaled: no other channel in it says
which thrust a command gives."""


@dataclass(frozen=True)
class Reference:
    """The vehicle and the flights that a flight is compared with."""

    vehicle: VehicleFile | None
    """Of other healthy flights of the vehicle; None: not asked with it."""
    healthy: Sequence[Flight]
    """As read; none: the way `healthy` is left out."""


@dataclass(frozen=True)
class Answer:
    """The answer of one way to one mutation."""

    mutation: str
    way: str
    named: bool
    text: str
    """The finding or the cause that names it; else the verdict."""


Way = Callable[[Flight, Reference], Diagnosis]


def ask_all(
    log: Flight, reference: Reference, progress: ProgressCallback = no_progress
) -> list[Answer]:
    """Return the answers about a log (as read) with each mutation, in each way that can be asked.

    Findings and causes in the sound log do not count.

    Args:
        log: a sound one.
        reference: vehicle and flights to compare with.
        progress: called with the mutation and the share done.
    """
    ways = [way for way in WAYS if reference.vehicle is not None or way != "vehicle"]
    ways = [way for way in ways if reference.healthy or way != "healthy"]
    answers = []
    for i, way in enumerate(ways):
        sound = _answers_about(WAYS[way](log, reference), log.name)
        for k, mutation in enumerate(MUTATIONS):
            progress(f"{way}: {mutation.name}", (i + k / len(MUTATIONS)) / len(ways))
            damaged = mutation.applied(log, (SEED, k))
            answers.append(_answer(mutation, way, damaged, reference, sound))
    return answers


def _answer(
    mutation: LogFault, way: str, log: Flight, reference: Reference, sound: set[str]
) -> Answer:
    try:
        diagnosis = WAYS[way](log, reference)
    except InputError as error:
        return Answer(mutation.name, way, mutation.named_by_error(error), str(error))
    findings = [
        f
        for f in diagnosis.prechecks
        if f.flight == log.name and _place(f) not in sound and mutation.named_by([f])
    ]
    new = [name for name in _effects(diagnosis) if name not in sound]
    causes = [name for name in new if name.split(".")[0] in mutation.effects]
    text = findings[0].message if findings else f"{diagnosis.verdict}: {', '.join(new)}"
    return Answer(mutation.name, way, bool(findings or causes), text)


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


def _plain(log: Flight, reference: Reference) -> Diagnosis:
    return diagnosed([log], nominal_model())


def _with_vehicle(log: Flight, reference: Reference) -> Diagnosis:
    assert reference.vehicle is not None
    file = reference.vehicle
    return diagnosed(held_against([log], file), nominal_model(vehicle=file))


def _against_healthy(log: Flight, reference: Reference) -> Diagnosis:
    return against_healthy([log], reference.healthy)


WAYS: Mapping[str, Way] = {"plain": _plain, "vehicle": _with_vehicle, "healthy": _against_healthy}
"""How `tombo diagnose` can be asked."""


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
