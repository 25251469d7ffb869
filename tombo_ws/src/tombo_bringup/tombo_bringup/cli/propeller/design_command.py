"""`tombo propeller design`: a nodus for a vehicle, and whether it flies as claimed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tombo_bringup.cli.options import Force, json_option, number_option, option, output_option
from tombo_bringup.cli.result_files import check_output, compute_into

if TYPE_CHECKING:
    from tombo_bringup.cli.progress import ProgressCallback
    from tombo_propeller.design.design import Design
    from tombo_propeller.design.flight_check import Recommendation

INFEASIBLE = 1
_MOST_FLIGHTS = 200


def _limit(declaration: str, text: str) -> Any:
    """Return an option with the bounds that `design.request` gives it."""

    def accepted() -> str:
        from tombo_propeller.design.request import BOUNDS

        unit, low, high = BOUNDS[declaration.split()[0]]
        return f"a number from {low:g} to {high:g} [{unit}]"

    return number_option(declaration, text, accepted)


def design(
    mass: Annotated[float, _limit("--mass KG", "Mass at take-off.")],
    frame: Annotated[
        str, option("--frame s500|MM", "Frame, or centre to rotor axis in millimetres.")
    ] = "s500",
    min_thrust_margin: Annotated[
        float, _limit("--min-thrust-margin X", "Usable thrust over weight, at least.")
    ] = 2.0,
    max_collision_force: Annotated[
        float | None, _limit("--max-collision-force N", "At 2000 rpm, as in Table III.")
    ] = None,
    max_recovery: Annotated[
        float | None, _limit("--max-recovery S", "Until a blade is straight again.")
    ] = None,
    max_noise: Annotated[float | None, _limit("--max-noise DB", "At 2000 rpm, 5 m away.")] = None,
    min_lift_over_drag: Annotated[
        float | None, _limit("--min-lift-over-drag X", "In hover.")
    ] = None,
    law: Annotated[str, option("--law", "repaired or consistent.")] = "repaired",
    library: Annotated[
        Path | None,
        option(
            "--library DIR",
            "Own materials.yaml, blades.yaml, configurations.yaml, measurements.yaml.",
        ),
    ] = None,
    blade: Annotated[str, option("--blade", "Of the library.")] = "nine_inch",
    confidence: Annotated[
        float, _limit("--confidence P", "That a predicted figure keeps to its limit.")
    ] = 0.9,
    extrapolate: Annotated[
        bool,
        option(
            "--extrapolate",
            "Let predictions of force, recovery and noise count outside of what was tested.",
        ),
    ] = False,
    flights: Annotated[
        int,
        number_option(
            "--flights N",
            "Collisions flown with a candidate; 0: none.",
            f"a whole number from 0 to {_MOST_FLIGHTS}",
            int,
        ),
    ] = 12,
    output: Annotated[str | None, output_option("Folder of the results; else none.")] = None,
    force: Force = False,
    as_json: Annotated[bool, json_option("Print design.json only.")] = False,
) -> None:
    """Recommend a nodus for a vehicle: matrix, fibres, length and place on the blade.

    The recommended one is flown in the paper's collision; claimed and simulated figures are
    printed side by side. With -o also design.yaml for `tombo fly`, design.json, a page, pictures.

    Exit code: 0 recommended; 1 nothing keeps to all limits, or to its claims in flight; 2 for bad
    input or output that can't be written; 130 after Ctrl-C, with nothing written.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_bringup.cli.tables import show_page
    from tombo_dynamics.errors import InputError
    from tombo_dynamics.propeller import read_library
    from tombo_flight.command_line import command_line
    from tombo_propeller.design.design import blade_of
    from tombo_propeller.design.flight_files import SCENARIO
    from tombo_propeller.design.page import DESIGN_FILES, design_page, write_design
    from tombo_propeller.design.request import DesignRequest, arm_of

    if not 0 <= flights <= _MOST_FLIGHTS:
        raise InputError(f"--flights {flights}: out of bounds; accepted: 0 to {_MOST_FLIGHTS}")
    check_output(output)
    if library is not None and not library.is_dir():
        raise InputError(
            f"--library {library}: no such folder; accepted: a folder with any of "
            "materials.yaml, blades.yaml, configurations.yaml, measurements.yaml"
        )
    known = read_library(library) if library is not None else read_library()
    chosen = blade_of(known, blade)
    request = DesignRequest(
        mass,
        arm_of(frame, chosen),
        min_thrust_margin,
        max_collision_force,
        max_recovery,
        max_noise,
        min_lift_over_drag,
        law,
        confidence,
        extrapolate,
    )

    def run(on_progress: ProgressCallback) -> tuple[Design, Recommendation]:
        from tombo_propeller.design.design import design as find
        from tombo_propeller.design.flight_check import recommend

        on_progress("loading the model", 0.0)
        result = find(request, known, chosen, on_progress)
        return result, recommend(result, range(flights), on_progress)

    path = None if output is None else Path(output)
    (result, recommendation), folder, written = compute_into(
        path, force, DESIGN_FILES, run,
        lambda folder, both, on_progress: write_design(folder.staging, *both, on_progress),
    )  # fmt: skip
    show_page(design_page(result, recommendation), as_json, None if as_json else folder, written)
    if SCENARIO in written and not as_json:
        typer.echo(f"Fly it: {command_line(('fly', f'{output}/{SCENARIO}'))}")
    if recommendation.index is None:
        raise typer.Exit(INFEASIBLE)
