"""`tombo mocap`: publish the poses of the vehicle's rigid body, until it is stopped."""

from __future__ import annotations

import dataclasses
import json
import sys

import typer

from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.run_command import replace_process_by
from tombo_mocap.params import ROS, MocapParams

app = typer.Typer()

_FIELDS = {field.name: field for field in dataclasses.fields(MocapParams)}
_TEXTS = {name: f"{field.metadata['doc'].capitalize()}." for name, field in _FIELDS.items()}
_DEFAULTS = {name: field.default for name, field in _FIELDS.items()}


@record
class _Source:
    system: str = argument("SYSTEM", _TEXTS["system"])
    place: str = argument(
        "[HOST|TOPIC]", "Address of the motion-capture computer; of system ros a topic.", ""
    )


@record
class _Body:
    body: str = option("--body NAME", _TEXTS["body"], _DEFAULTS["body"])
    up: str = option("--up AXIS", _TEXTS["up"], _DEFAULTS["up"])
    nose: str = option("--nose AXIS", _TEXTS["nose"], _DEFAULTS["nose"])
    frame: str = option("--frame ID", _TEXTS["frame"], _DEFAULTS["frame"])
    delay: float = option("--delay S", _TEXTS["delay"], _DEFAULTS["delay"])
    settings: list[str] | None = option(
        "--option KEY=VALUE", "A setting of libmotioncapture. May be given many times."
    )


@command(app, "mocap", lab=True, epilog="Exit code: 0 when it was stopped, 2 for bad input.")
def mocap(source: _Source, tracked: _Body) -> None:
    """Publish the poses of the vehicle's rigid body as /mocap/pose, until it is stopped.

    They are in map, of base_link, with the time of their capture, whatever the axes of the system
    are. It is the node mocap_node of tombo_mocap.
    """
    place = "topic" if source.system == ROS else "host"
    params = MocapParams(
        system=source.system, body=tracked.body, up=tracked.up, nose=tracked.nose,
        frame=tracked.frame, delay=tracked.delay, options=" ".join(tracked.settings or ()),
        **{place: source.place},
    )  # fmt: skip
    params.check()
    words = ["--ros-args"]
    for name, value in dataclasses.asdict(params).items():
        if value != _DEFAULTS[name]:
            words += ["-p", f"mocap.{name}:={json.dumps(value)}"]  # a body may be called 1
    sys.stderr.write(f"/mocap/pose from {source.system} {source.place}; Ctrl-C ends it\n")
    replace_process_by("tombo_mocap", "mocap_node", words)
