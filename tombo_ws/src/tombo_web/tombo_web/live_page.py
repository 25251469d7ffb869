"""The page of `tombo live`: one HTML text, with the scene of the flight report."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from tombo_flight.report.flight_report import scene_block, script_json
from tombo_flight.report.page import asset

_SCENE: Final = ("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js")
FIRST_PICKED: Final = (
    "/odometry.position.z",
    "/detector/status.statistic",
    "/ground_truth/rotors.thrust.2",
    "/mocap/pose.position.z",
)
"""Signals drawn as curves where nobody has picked others, as far as they come."""


def live_page(title: str, scenario: Mapping[str, Any]) -> str:
    """Return the HTML of the page; it loads nothing from anywhere.

    Args:
        title: name of the flight.
        scenario: of the flight, for the lengths of the vehicle; empty: the default vehicle.
    """
    instants = ("contact_s", "unstable_end_s", "recovery_end_s", "fall_m")
    milestones = {**dict.fromkeys(instants), "verdict": "", **scene_block(scenario)}
    return template("live.html.j2").render(
        title=title,
        scripts=_SCENE,
        css=Markup(asset_text("live.css")),
        script=Markup(asset_text("live.js")),
        data=Markup(script_json({"milestones": milestones, "first_picked": FIRST_PICKED})),
    )


def template(name: str) -> Template:
    """Return a template of this package; `asset(name)` in it is an asset of the reports."""
    environment = Environment(
        loader=PackageLoader("tombo_web", "assets"), autoescape=True, undefined=StrictUndefined
    )
    environment.globals["asset"] = lambda name: Markup(asset(name))
    return environment.get_template(name)


def asset_text(name: str) -> str:
    """Return the text of a file in the folder of the templates."""
    return (resources.files("tombo_web") / "assets" / name).read_text(encoding="utf-8")
