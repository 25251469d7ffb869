"""From a request and a library to a design: all candidates, evaluated and ranked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.propeller import Blade, Configuration, Library
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_propeller.design.candidate_evaluation import CandidateEvaluation, judge, thrust_error
from tombo_propeller.design.candidate_ranking import Choice, choose
from tombo_propeller.design.candidates import TestedRange, candidates, measured_soft, tested
from tombo_propeller.design.operating_points import flight_performance
from tombo_propeller.design.request import MEASURED, Request, vehicle_for
from tombo_propeller.design.response_regression import ResponseModel, read


@dataclass(frozen=True, eq=False)
class Design:
    """All candidates with their evaluation and ranking."""

    request: Request
    vehicle: VehicleParams
    """As it flies with the blade's own nodus."""
    blade: Blade
    measured: tuple[Configuration, ...]
    tested: TestedRange
    readings: Mapping[str, ResponseModel]
    thrust_error: float
    """RMS error of the model's thrust at 2000 rpm, as a share."""
    judged: CandidateEvaluation
    choice: Choice

    @property
    def feasible(self) -> bool:
        """Whether anything keeps to the limits."""
        return bool(self.choice.order)


def blade_of(library: Library, name: str) -> Blade:
    """Return a blade of a library.

    Raises:
        InputError: there is no such blade.
    """
    if name not in library.blades:
        raise unknown_name("blade", name, library.blades)
    return library.blades[name]


def design(
    request: Request, library: Library, blade: Blade, on_progress: ProgressCallback = no_progress
) -> Design:
    """Evaluate and rank all candidates.

    Args:
        request: what is asked for.
        library: materials, configurations and measurements.
        blade: that the propeller is made with; a nodus may be put anywhere on it.
        on_progress: called with the progress.

    Raises:
        InputError: the library has no measured soft propeller with this blade, or the vehicle is
            outside of what the simulator takes.
    """
    vehicle = vehicle_for(request, blade)
    measured = measured_soft(library, blade)
    readings = {name: read(name, measured) for name in MEASURED}
    span = tested(measured)
    on_progress("candidates", 0.0)
    every = candidates(library, blade)
    on_progress(f"{len(every)} candidates", 0.1)
    operating = flight_performance(every, vehicle, request.law)
    on_progress("judging", 0.9)
    judged = judge(every, operating, readings, span, request, vehicle)
    error = thrust_error(measured, request.law)
    if not judged.value[:, 0].max() > 0.0:
        raise InputError(f"blade {blade.name}: no nodus gives thrust; accepted: another blade")
    choice = choose(judged, request.limits, error)
    return Design(request, vehicle, blade, measured, span, readings, error, judged, choice)
