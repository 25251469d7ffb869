"""Cases of the second simulator: which vehicle, what is hidden, with which sensors and logs.

Kinds and sizes are those of the suite's own benchmark, so the scores compare. All of it derives
from (seed, number of the case).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tombo_bag.schemas import own_definitions
from tombo_benchmarks.diagnosis.cases import (
    KINDS,
    UNKNOWN_SIZES,
    Case,
    draw_factor,
    draw_hidden,
    draw_name,
    draw_size,
)
from tombo_benchmarks.diagnosis.flight_cases import FORMULATIONS
from tombo_benchmarks.diagnosis.second_simulator.courses import KINDS as COURSES
from tombo_benchmarks.diagnosis.second_simulator.flight import fly
from tombo_benchmarks.diagnosis.second_simulator.hidden import (
    NEEDS_IMU,
    TYPICAL,
    Hidden,
    draw_shift,
    draw_tolerances,
)
from tombo_benchmarks.diagnosis.second_simulator.log_files import (
    mapping_text,
    vehicle_text,
    write_bag,
    write_table,
)
from tombo_benchmarks.diagnosis.second_simulator.sensors import CHAINS, Stream, measure
from tombo_benchmarks.diagnosis.second_simulator.strangers import (
    STRANGERS,
    Stranger,
    draw_stranger,
)
from tombo_benchmarks.diagnosis.second_simulator.vehicles import VEHICLES, Quadrotor

_VEHICLES = (("s500", 0.6), ("x500", 0.2), ("crazyflie", 0.2))
_KNOWN = (("file", 0.75), ("airframe", 0.25))
_CHAINS = tuple((chain, 0.5) for chain in CHAINS)
_FORMATS = (("table", 0.4), ("turned_table", 0.4), ("bag", 0.2))
_DURATION_S = 20.0
_LATEST_STAMP_S = 0.009
"""Later than it arrives no stamp can be."""


@dataclass(frozen=True)
class ForeignCase(Case):
    """Flights of the second simulator with something hidden."""

    vehicle: Quadrotor
    known: str
    """What is told of the vehicle: model (the suite's own), file (a vehicle file), airframe (mass,
    arms, inertia and motor time constant, in the mapping)."""
    chain: str
    log_format: str
    truth: Hidden
    """What is hidden and what a careful lab leaves."""
    stranger: Stranger
    """What no effect describes, if that is hidden."""
    seed: tuple[int, int]

    @property
    def present(self) -> frozenset[str]:
        """Effects that are there beside what is hidden: to name one of them is no mistake.

        A vehicle without a model of its own has drag that no datasheet tells; by its airframe
        alone ground effect and a latency of its motion capture, too.
        Markers and IMU stay at the frame's centre when the centre of gravity moves.
        """
        found = set() if self.known == "model" else {"linear_rotor_drag"}
        if self.known == "airframe":
            found |= {"ground_effect", "mocap_latency"}
        if "cog_offset" in self.hidden:
            found |= {"mocap_marker_offset", "imu_lever_arm"}
        return frozenset(found - set(self.hidden))


def draw_case(seed: int, number: int) -> ForeignCase:
    """Return a case; the same for the same seed and number."""
    rng = np.random.default_rng([seed, number, 11])
    kind = draw_name(rng, KINDS)
    size = draw_size(rng, kind)
    vehicle = VEHICLES[draw_name(rng, _VEHICLES)]
    told = "model" if vehicle.own_model else draw_name(rng, _KNOWN)
    formulation = draw_name(rng, FORMULATIONS)
    chain, log_format = draw_name(rng, _CHAINS), draw_name(rng, _FORMATS)
    hidden: Sequence[str] = draw_hidden(rng, kind, candidates(told, formulation))
    if kind == "unknown":
        hidden = [str(rng.choice(STRANGERS))]
    return make_case(
        (seed, number), kind, size, hidden, vehicle, formulation, chain, log_format, told
    )


def make_case(
    seed: tuple[int, int],
    kind: str,
    size: str,
    hidden: Sequence[str],
    vehicle: Quadrotor,
    formulation: str = "imu_rpm",
    chain: str = "plain",
    log_format: str = "table",
    told: str = "",
) -> ForeignCase:
    """Return a case of this kind; directions and tolerances are drawn.

    `told`: see `ForeignCase.known`; empty: all that is known.
    """
    told = told or ("model" if vehicle.own_model else "file")
    rng = np.random.default_rng([*seed, 12])
    values = draw_tolerances(vehicle, rng)
    shift: dict[str, float] = {}
    stranger = Stranger()
    if kind == "unknown":
        stranger = draw_stranger(hidden[0], UNKNOWN_SIZES[size], vehicle, rng)
    else:
        for name in hidden:
            shift |= draw_shift(name, draw_factor(rng, size), vehicle, rng)
    for label, change in shift.items():
        values[label] += change
        if label == "mocap_stamp_error.offset" and values[label] > _LATEST_STAMP_S:
            values[label] = -values[label]
        shift[label] = values[label]
    return ForeignCase(
        seed[1], kind, size, formulation, tuple(hidden), shift, vehicle, told, chain,
        log_format, Hidden(values), stranger, seed,
    )  # fmt: skip


def candidates(told: str, formulation: str) -> list[str]:
    """Return the effects that flights with these sensors can show at all."""
    blind = set() if formulation.startswith("imu") else set(NEEDS_IMU)
    if told == "airframe":  # it says neither the full voltage nor what the propellers lift
        blind |= {"battery_sag", "mass_error", "thrust_coefficient_error"}
    if told == "file" and not formulation.endswith("rpm"):
        blind.add("battery_sag")  # part of its drive, as the voltage is measured
    return [name for name in TYPICAL if name not in blind]


@dataclass(frozen=True)
class WrittenFlights:
    """The files of a case."""

    logs: list[Path]
    mapping: Path | None
    """That reads the logs."""
    vehicle: Path | None
    """The vehicle file."""

    @property
    def arguments(self) -> list[str]:
        """Return the arguments of `tombo diagnose`."""
        options = (("--mapping", self.mapping), ("--vehicle", self.vehicle))
        given = [(name, str(path)) for name, path in options if path is not None]
        return [*map(str, self.logs), *(word for pair in given for word in pair)]


def write_flights(case: ForeignCase, folder: Path) -> WrittenFlights:
    """Fly, measure and write the files.

    Raises:
        LostError: with what is hidden the vehicle can't fly.
    """
    rng = np.random.default_rng([*case.seed, 13])
    flown = fly(case.vehicle, case.truth, replace(case.stranger), COURSES, _DURATION_S, rng)
    logs = []
    for f, course in enumerate(COURSES):
        measured = measure(flown, f, case.truth, case.formulation, case.chain, rng)
        if not (case.vehicle.own_model or case.formulation.endswith("rpm")):
            measured = _as_throttle(measured, case.vehicle)
        if case.log_format == "bag":
            logs.append(folder / course)
            write_bag(logs[-1], measured, own_definitions()["tombo_msgs/msg/RotorSpeeds"])
        else:
            logs.append(folder / f"{course}.csv")
            write_table(logs[-1], measured, case.log_format == "turned_table")
    mapping = vehicle = None
    if case.log_format != "bag" or case.known == "airframe":
        mapping = folder / "mapping.yaml"
        frame = case.vehicle if case.known == "airframe" else None
        text = mapping_text(measured, case.log_format == "turned_table", frame)
        mapping.write_text(text, encoding="utf-8")
    if case.known == "file":
        vehicle = folder / "vehicle.yaml"
        vehicle.write_text(vehicle_text(case.vehicle), encoding="utf-8")
    return WrittenFlights(logs, mapping, vehicle)


def _as_throttle(measured: dict[str, Stream], quad: Quadrotor) -> dict[str, Stream]:
    """Return streams with the commands from 0 to 1, as of drives that measure no speed."""
    asked = measured["command"]
    rest = {key: stream for key, stream in measured.items() if key != "command"}
    return rest | {"throttle": replace(asked, values=quad.throttle(asked.values))}
