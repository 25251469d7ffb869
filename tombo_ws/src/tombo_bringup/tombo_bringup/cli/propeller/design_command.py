"""`tombo propeller design`: a nodus for a vehicle, and whether it flies as claimed.

The nodus is the elastic joint between hub and blade by which the propeller folds in a collision.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli.options import Law, OwnLibrary, Results, option, record
from tombo_bringup.cli.result_files import publish
from tombo_propeller.design.limits import DesignLimits

if TYPE_CHECKING:
    from tombo_flight.progress import ProgressCallback
    from tombo_propeller.design.design import Design
    from tombo_propeller.design.flight_check import Recommendation

INFEASIBLE = 1
"""Exit code: no candidate is recommended."""


@record
class _Design:
    frame: str = option(
        "--frame s500|MM", "Frame, or centre to rotor axis in millimetres.", "s500"
    )
    blade: str = option("--blade NAME", "Of the library.", "nine_inch")
    extrapolate: bool = option(
        "--extrapolate",
        "Let predictions of force, recovery and noise count outside of what was tested.",
        False,
    )
    flights: int = option(
        "--flights N", "Collisions flown with a candidate; 0: none.", 12, bounds=(0, 200)
    )


def design(
    limits: DesignLimits, law: Law, given: _Design, own: OwnLibrary, results: Results
) -> None:
    """Recommend a nodus for a vehicle: matrix, fibres, length and place on the blade.

    The recommended one is flown in the paper's collision; claimed and simulated figures are
    printed side by side. With -o also design.yaml for `tombo fly`, design.json, a page, pictures.

    Exit code: 0 recommended; 1 nothing keeps to all limits, or to its claims in flight; 2 for bad
    input or output that can't be written; 130 after Ctrl-C, with nothing written.
    """
    # before numpy is loaded: the matrices are too small for threads
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_flight.command_line import command_line
    from tombo_propeller.design.design import blade_of
    from tombo_propeller.design.flight_files import SCENARIO
    from tombo_propeller.design.page import DESIGN_FILES, design_page, write_design
    from tombo_propeller.design.request import DesignRequest, arm_of

    library = own.read()
    blade = blade_of(library, given.blade)
    request = DesignRequest(
        **vars(limits),
        arm_m=arm_of(given.frame, blade),
        law=law.law or "repaired",
        extrapolate=given.extrapolate,
    )

    def run(on_progress: ProgressCallback) -> tuple[Design, Recommendation]:
        """Compute all candidates, then fly the best until one keeps to its claims."""
        from tombo_propeller.design.design import design as compute_design
        from tombo_propeller.design.flight_check import recommend

        on_progress("loading the model", 0.0)
        result = compute_design(request, library, blade, on_progress)
        return result, recommend(result, range(given.flights), on_progress)

    (_, recommendation), written = publish(
        results,
        name=None,
        files=DESIGN_FILES,
        compute=run,
        page=lambda both, folder: design_page(*both),
        write=lambda folder, both, on_progress: write_design(folder.staging, *both, on_progress),
    )
    if SCENARIO in written and not results.as_json:
        typer.echo(f"Fly it: {command_line(('fly', f'{results.output}/{SCENARIO}'))}")
    if recommendation.index is None:
        raise typer.Exit(INFEASIBLE)
