"""`tombo check mocap`: mistakes of a motion capture, live or in a recording."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import argument, command, option, record
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_bag.flight import Flight
    from tombo_logs.mocap_quality import MocapQuality

app = typer.Typer(
    name="check",
    hidden=True,
    no_args_is_help=True,
    help="Look for mistakes of a set-up before a flight.",
    context_settings=options.HELP_OPTIONS,
)

_UNITS = {"hz": "Hz"}


@record
class _Poses:
    file: Path | None = argument("[FILE]", "A recording, as of `tombo report`.", None)
    seconds: float = option(
        "--seconds S",
        "Without FILE: listen to /mocap/pose for so long.",
        10.0,
        bounds=(2.0, 600.0),
    )


@command(
    app,
    epilog="Exit code: 0 when no mistake is seen; 1 when one is; 2 for bad input, or no poses.",
)
def mocap(
    poses: _Poses, reading: options.Reading, domain: options.Domain, shown: options.Shown
) -> None:
    """Look for ten mistakes of a motion capture, and print the figures that a lab keeps.

    Without FILE it listens to /mocap/pose: carry the vehicle about meanwhile, and let it lie still
    for two seconds. A turned rigid body shows in a recording with a gyro, after a flight.
    """
    from tombo_logs.mocap_quality import check_mocap

    if poses.file is None:
        log = _listen(poses.seconds, domain.domain)
    else:
        from tombo_logs.readers.log_reader import read_single_log

        log = read_single_log(poses.file, reading.mapping, reading.names)
    quality = check_mocap(log)
    if shown.as_json:
        print(json.dumps({**_mapping(quality), "source": log.source}, indent=1))
    else:
        _show(quality)
    raise typer.Exit(1 if quality.findings else 0)


def _mapping(quality: MocapQuality) -> dict[str, object]:
    findings = [{"key": key, "message": text} for key, text in quality.findings.items()]
    return {"good": not findings, "findings": findings, "figures": quality.figures}


def _show(quality: MocapQuality) -> None:
    from tombo_bringup.cli.tables import console

    for name, value in quality.figures.items():
        *label, unit = name.split("_") if "_" in name else (name, "")
        text = "not known" if value is None else f"{value:.4g} {_UNITS.get(unit, unit)}"
        typer.echo(f"{' '.join(label):20} {text}")
    print()
    for key, text in quality.findings.items():
        console(highlight=False).print(f"[bold]{key}[/bold]: {text}")
    if not quality.findings:
        print("No mistake is seen.")


def _listen(seconds: float, domain: int | None) -> Flight:
    """Return the poses of a while on /mocap/pose, on a clock that begins with the first.

    Raises:
        InputError: nobody publishes.
    """
    import numpy as np

    from tombo_bag.flight import Flight, Series
    from tombo_dynamics.time_base import SECOND_NS
    from tombo_flight.suite.nodes import discovery_environment

    environment = discovery_environment(os.environ, domain)
    sys.stderr.write(f"listening to /mocap/pose for {seconds:g} s\n")
    words = ["-m", "tombo_mocap.pose_listener_node", str(seconds)]
    run = subprocess.run(
        [sys.executable, *words], env=environment, stdout=subprocess.PIPE, check=True
    )
    rows = [json.loads(line) for line in run.stdout.splitlines()]
    if not rows:
        raise InputError("nothing on /mocap/pose; accepted: a driver, or `tombo mocap`, that runs")
    begin_ns = rows[0][1]  # a double has not the digits of a time since 1970
    arrival, stamp = ((np.array([row[k] - begin_ns for row in rows]) / SECOND_NS) for k in (0, 1))
    poses = np.array([row[2:] for row in rows])
    parts = {"position": poses[:, :3], "attitude": poses[:, 3:]}
    series = {name: Series(stamp, values, arrival) for name, values in parts.items()}
    return Flight.measured("mocap", "/mocap/pose", series)
