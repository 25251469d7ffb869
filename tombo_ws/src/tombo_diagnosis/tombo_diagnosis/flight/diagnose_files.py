"""From files of flights to a diagnosis: read, check, diagnose. What `tombo diagnose` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tombo_bag.flight import Finding, Flight
from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.analyse import FlightFindings
from tombo_diagnosis.flight.diagnose import Separate, diagnose_flights
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.scenario_nominal import held_against
from tombo_dynamics.errors import InputError
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.vehicle_file import VehicleFile
from tombo_logs.checks import check_log
from tombo_logs.checks.pipeline import POSE
from tombo_logs.checks.rotors.hover import Hover, hover_of
from tombo_logs.readers.log_reader import read_logs


def read_and_check(
    paths: Sequence[Path],
    mapping: Path | str | None = None,
    names: Mapping[str, str] | None = None,
    vehicle: VehicleFile | None = None,
    nominal: NominalModel | None = None,
    progress: ProgressCallback = no_progress,
) -> tuple[list[Flight], list[Finding]]:
    """Return the flights of files, held against a vehicle file and a model if given, checked.

    Also why others are left out: what contradicts itself costs its own flight only.

    Raises:
        InputError: as `read_logs`; or as `check_log`, if no flight is left.
    """
    progress(f"reading {paths[0].name}{' and others' if len(paths) > 1 else ''}", 0.0)
    flights = read_logs(paths, mapping=mapping, names=names)
    if vehicle is not None:
        flights = held_against(flights, vehicle)
    hover = None
    if nominal is not None:
        hover = hover_of(nominal.label, nominal.vehicle, nominal.maps)
    return check_flights(flights, hover, progress=progress)


def check_flights(
    flights: Sequence[Flight],
    hover: Hover | None = None,
    needed: Sequence[str] = POSE,
    progress: ProgressCallback = no_progress,
) -> tuple[list[Flight], list[Finding]]:
    """Return the flights that pass `check_log`, checked, and why others are left out.

    Raises:
        InputError: no flight is left; why the first is not.
    """
    checked, refused = [], []
    first: InputError | None = None
    for k, flight in enumerate(flights):
        progress(f"checking {flight.name}", k / len(flights))
        try:
            checked.append(check_log(flight, hover, needed))
        except InputError as error:
            refused.append(Finding("refused", "fault", flight.name, str(error)))
            first = first or error
    if first is not None and not checked:
        raise first
    return checked, refused


def diagnose_files(
    paths: Sequence[Path],
    nominal: NominalModel,
    mapping: Path | str | None = None,
    names: Mapping[str, str] | None = None,
    vehicle: VehicleFile | None = None,
    progress: ProgressCallback = no_progress,
    separate: Separate | None = None,
    clock: Callable[[], float] = lambda: 0.0,
) -> tuple[Diagnosis, FlightFindings]:
    """Read, check and diagnose flights: see `read_and_check` and `diagnose_flights`.

    Raises:
        InputError: a log or the mapping can't be used, or no flight can.
    """
    logs, refused = read_and_check(paths, mapping, names, vehicle, nominal, progress)
    return diagnose_flights(logs, nominal, progress, separate, clock, refused)
