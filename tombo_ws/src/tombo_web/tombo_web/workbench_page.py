"""The page of `tombo workbench`: one HTML text that loads nothing."""

from __future__ import annotations

from typing import Any, Final

from markupsafe import Markup

from tombo_dynamics.propeller import LAWS, Configuration, Library
from tombo_flight.report.flight_report import script_json
from tombo_flight.report.page import asset
from tombo_propeller.workbench.propeller_choice import KNOBS, default_knobs
from tombo_web.live_page import asset_text, template

_LAW_COLOURS: Final = dict(zip(LAWS, ("vermillion", "blue", "green"), strict=True))
_KNOB_WORDS: Final = {
    "fibres": "Fibres",
    "fibre_diameter_mm": "Fibre diameter",
    "length_mm": "Length of the nodus",
    "outer_radius_mm": "Where the wing begins",
}


def workbench_page(library: Library) -> str:
    """Return the HTML of the page for the materials and configurations of a library."""
    data: dict[str, Any] = {
        "colours": _LAW_COLOURS,
        "measured_blades": sorted(
            {c.blade.name for c in library.configurations.values() if c.nodus and c.measured}
        ),
        "knobs": {name: default_knobs(blade) for name, blade in library.blades.items()},
        "configurations": {
            c.number: {"blade": c.blade.name, **knobs_of(c)}
            for c in library.configurations.values()
            if c.nodus is not None
        },
    }
    return template("workbench.html.j2").render(
        blades=list(library.blades),
        matrices=list(library.matrices),
        fibres=list(library.fibres),
        configurations=[c.number for c in library.configurations.values() if c.nodus],
        knobs=[(name, _KNOB_WORDS[name], *KNOBS[name]) for name in KNOBS],
        laws=_LAW_COLOURS,
        css=Markup(asset_text("workbench.css")),
        charts=Markup(asset("charts.js")),
        script=Markup(asset_text("workbench.js")),
        data=Markup(script_json(data)),
    )


def knobs_of(configuration: Configuration) -> dict[str, Any]:
    """Return the materials and the values of the knobs of a propeller with a nodus."""
    nodus = configuration.nodus
    assert nodus is not None
    return {
        "matrix": nodus.matrix.name,
        "fibre": nodus.fibre.name,
        "fibres": nodus.fibres,
        "fibre_diameter_mm": nodus.fibre_diameter_mm,
        "length_mm": nodus.length_mm,
        "outer_radius_mm": 1e3 * configuration.blade.joint.outer_radius_m,
    }
