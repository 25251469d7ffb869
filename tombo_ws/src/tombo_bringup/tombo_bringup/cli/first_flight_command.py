"""`tombo first-flight`: from a lab file to the first flights of a vehicle, step by step."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import typer

from tombo_bringup.cli import options
from tombo_bringup.cli.options import command, option, record
from tombo_dynamics.errors import InputError

app = typer.Typer()

_FOLDER = Path("runs/first-flight")


@record
class _FirstFlight:
    lab_file: Path | None = option("--lab FILE", "The lab file (`tombo lab`); or TOMBO_LAB.")
    answers: Path | None = option("--answers FILE", "YAML: step → answer, in place of a person.")
    first: str | None = option(
        "--from STEP", "Begin with this step. Default: the first that is not passed."
    )
    seconds: float = option(
        "--seconds S", "Listen to the motion capture for so long.", 20.0, bounds=(2.0, 600.0)
    )
    hover: float = option("--hover S", "Hover for so long.", 20.0, bounds=(1.0, 600.0))


@command(
    app,
    "first-flight",
    epilog="Exit code: 0 when all steps are passed, 1 when one has failed, 2 for bad input.",
)
def first_flight(
    given: _FirstFlight, values: options.Settings, domain: options.Domain, place: options.Copies
) -> None:
    """Guide through the first flight of a real vehicle.

    Each step is a check of the machine, or a question to you. Its outcome is written into
    first_flight.yaml next to the recordings; the same command goes on with the first step that is
    not passed. The steps: docs/first_real_flight.md.
    """
    from tombo_bringup.first_flight.checks import Session
    from tombo_bringup.first_flight.runner import FILE, Answers, do_steps, read_record, steps_to_do
    from tombo_bringup.lab_file import read_lab
    from tombo_dynamics.yaml_text import parse_yaml, read_text
    from tombo_flight.yaml_file import mapping_of

    name = given.lab_file or os.environ.get("TOMBO_LAB", "")
    if not name:
        raise InputError("no lab file; accepted: --lab FILE, or TOMBO_LAB")
    file = Path(name)
    lab = read_lab(file)
    if not lab.url:
        raise InputError(f"'{file}': no px4.url; accepted: as serial:///dev/ttyUSB0:921600")
    answers: Any = {}
    if given.answers is not None:
        label = f"'{given.answers}'"
        answers = mapping_of(parse_yaml(read_text(given.answers, label), label), label)
    prompts = typer.prompt if sys.stdin.isatty() and given.answers is None else None
    person = Answers(answers, prompts)
    folder = _FOLDER if place.output is None else Path(place.output)
    done = read_record(folder / FILE)
    steps = steps_to_do(done, given.first)
    folder.mkdir(parents=True, exist_ok=True)
    session = Session(
        file, lab, folder, person.ask, lambda text: typer.echo(text, err=place.as_json),
        domain.domain, given.seconds, given.hover, tuple(values.settings or ()),
    )  # fmt: skip
    passed = do_steps(session, steps, done)
    if place.as_json:
        import json

        from tombo_flight.json_text import plain

        print(json.dumps(plain({"passed": passed, "steps": done}), indent=1))
    elif passed:
        typer.echo(f"All steps are passed; they are written down in {folder / FILE}.")
    raise typer.Exit(0 if passed else 1)
