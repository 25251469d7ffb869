"""The files of a design: JSON, page and pictures, and what `tombo fly` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tombo_flight.json_text import as_json
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_flight.report.flight_plot import figure_bytes
from tombo_propeller.design.design import Design
from tombo_propeller.design.design_json import design_mapping
from tombo_propeller.design.flight_files import (
    LIBRARY,
    LIBRARY_FILES,
    SCENARIO,
    scenario_of,
    write_flyable,
)
from tombo_propeller.design.page import design_html
from tombo_propeller.design.plots import draw_pareto, draw_readings
from tombo_propeller.design.recommend import Recommendation
from tombo_propeller.design.request import NAMES

JSON: Final = "design.json"
PAGE: Final = "report.html"
PICTURES: Final = ("pareto.png", "readings.png")
DESIGN_FILES: Final = (
    JSON,
    PAGE,
    SCENARIO,
    *PICTURES,
    *(f"{LIBRARY}/{name}" for name in LIBRARY_FILES),
)
"""All names that a design may write: those of an earlier one give way."""


def write_design(
    folder: Path, found: Design, made: Recommendation, on_progress: ProgressCallback = no_progress
) -> None:
    """Write the files of a design into a folder that exists.

    Raises:
        OSError: they can't be written.
    """
    text = as_json(design_mapping(found, made))
    (folder / JSON).write_text(text, encoding="utf-8", newline="\n")
    if made.index is not None:
        configuration = found.judged.configurations[made.index]
        high = found.judged.high[made.index]
        force, recovery = (
            float(high[NAMES.index(name)]) for name in ("collision_force_N", "recovery_s")
        )
        scenario = scenario_of(found.request, configuration, force, recovery)
        write_flyable(folder, scenario, configuration)
    on_progress("drawing", 0.5)
    pictures = [figure_bytes(draw_pareto(found, made)), figure_bytes(draw_readings(found))]
    for name, picture in zip(PICTURES, pictures, strict=True):
        (folder / name).write_bytes(picture)
    page = design_html(found, made, pictures)
    (folder / PAGE).write_text(page, encoding="utf-8", newline="\n")
