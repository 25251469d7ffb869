"""From paths and names, as people give them, to a diagnosis of flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.flight.diagnose_files import diagnose_files
from tombo_diagnosis.flight.experiment_design import separate
from tombo_diagnosis.flight.scenario_nominal import nominal_model
from tombo_flight.extended_model import Model
from tombo_flight.model_file import read_model
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.vehicle_file import read_vehicle


def diagnose_logs(
    logs: Sequence[Path],
    model: Path | None,
    mapping: str | None,
    names: Mapping[str, str],
    vehicle: str | None,
    clock: Callable[[], float],
    on_progress: ProgressCallback = no_progress,
) -> tuple[Diagnosis, str, Model | None]:
    """Read, check and diagnose flights.

    Args:
        logs: files or folders.
        model: a model.yaml that the flights are compared with.
        mapping: file, or name of a shipped one.
        names: topic as recorded → name in this suite.
        vehicle: name or file of the vehicle that flew.
        clock: tells the time [s], to say how long it took.
        on_progress: told the progress.

    Returns:
        The diagnosis, the name of what the flights were compared with, and the model given.

    Raises:
        InputError: a log, the mapping, the vehicle or the model can't be used.
    """
    base = None if model is None else read_model(model)
    nominal = nominal_model(model, vehicle)
    file = None if vehicle is None else read_vehicle(vehicle)
    found, _ = diagnose_files(logs, nominal, mapping, names, file, on_progress, separate, clock)
    return found, nominal.label, base
