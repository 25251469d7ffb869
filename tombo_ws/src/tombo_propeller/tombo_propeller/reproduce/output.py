"""The files of a reproduction: page, JSON, figures."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

from tombo_flight.json_text import as_json
from tombo_flight.progress import ProgressCallback
from tombo_propeller.reproduce.page import reproduction_html
from tombo_propeller.reproduce.plots import FIGURES
from tombo_propeller.reproduce.reproduction import Reproduction

if TYPE_CHECKING:
    from tombo_flight.process.output_folder import OutputFolder

JSON: Final = "reproduction.json"
PAGE: Final = "reproduction.html"
REPRODUCTION_FILES: Final = (JSON, PAGE, *FIGURES)
"""All names that a reproduction writes: those of an earlier one give way."""


def write_reproduction(
    folder: OutputFolder, r: Reproduction, on_progress: ProgressCallback
) -> None:
    """Write all files into an output folder, which the caller publishes."""
    pictures = {}
    for k, (name, (draw, _, _)) in enumerate(FIGURES.items()):
        on_progress(f"drawing {name}", k / len(FIGURES))
        sheet = io.BytesIO()
        draw(r).savefig(sheet, format="png")
        pictures[name] = sheet.getvalue()
        (folder / name).write_bytes(pictures[name])
    (folder / JSON).write_text(as_json(r.mapping()), encoding="utf-8", newline="\n")
    (folder / PAGE).write_text(reproduction_html(r, pictures), encoding="utf-8", newline="\n")
