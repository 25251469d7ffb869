"""`tombo mocap`: publish the poses of the vehicle's rigid body, until it is stopped."""

from __future__ import annotations

import dataclasses
import json
import sys
from typing import Any

import typer

from tombo_bringup.cli.options import argument, command, option, record
from tombo_bringup.cli.run_command import replace_process_by
from tombo_mocap.params import ROS, MocapParams

app = typer.Typer()

_FIELDS = {field.name: field for field in dataclasses.fields(MocapParams)}
_TEXTS = {name: f"{field.metadata['doc'].capitalize()}." for name, field in _FIELDS.items()}


def _option(name: str, metavar: str) -> Any:
    default = str(_FIELDS[name].default)
    return option(f"--{name} {metavar}", _TEXTS[name], show_default=default or False)


@record
class _Mocap:
    system: str | None = argument("SYSTEM", _TEXTS["system"], None)
    host: str | None = argument(
        "[HOST|TOPIC]", "Address of the motion-capture computer; of system ros a topic.", None
    )
    body: str | None = _option("body", "NAME")
    bodies: str | None = _option("bodies", "NAMES")
    up: str | None = _option("up", "AXIS")
    nose: str | None = _option("nose", "AXIS")
    delay: float | None = _option("delay", "S")
    options: list[str] | None = option(
        "--option KEY=VALUE", "A setting of libmotioncapture. May be given many times."
    )


@command(app, "mocap", lab=True, epilog="Exit code: 0 when it was stopped, 2 for bad input.")
def mocap(given: _Mocap) -> None:
    """Publish the poses of the vehicle's rigid body as /mocap/pose, until it is stopped.

    With --bodies those of several vehicles, as /v1/mocap/pose, /v2/mocap/pose.

    They are in map, of base_link, with the time of their capture, whatever the axes of the system
    are. It is the node mocap_node of tombo_mocap.
    """
    values = {name: value for name, value in vars(given).items() if value is not None}
    values["options"] = " ".join(given.options or ())
    if given.system == ROS and given.host is not None:
        values["topic"] = values.pop("host")
    params = MocapParams(**values)
    params.check()
    words = ["--ros-args"]
    for name, value in vars(params).items():
        if value != _FIELDS[name].default:
            words += ["-p", f"mocap.{name}:={json.dumps(value)}"]  # a body may be called 1
    topics = ", ".join(f"{space}/mocap/pose" for space in params.tracked)
    sys.stderr.write(f"{topics} from {given.system} {given.host or ''}; Ctrl-C ends it\n")
    replace_process_by("tombo_mocap", "mocap_node", words)
