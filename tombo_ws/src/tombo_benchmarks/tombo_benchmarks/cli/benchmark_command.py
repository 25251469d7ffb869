"""`tombo benchmark`: blind tests of the suite's diagnoses and safety."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

from tombo_benchmarks.cli.benchmark_run import EXIT_CODES, DrawnCases, Scored
from tombo_bringup.cli.options import (
    LogMapping,
    Shown,
    VehicleName,
    argument,
    command,
    option,
    record,
)
from tombo_dynamics.errors import InputError

if TYPE_CHECKING:
    from tombo_benchmarks.diagnosis.runner import BenchmarkResult

app = typer.Typer()


@app.callback(invoke_without_command=True)
def benchmark(ctx: typer.Context) -> None:
    """Blind tests of the suite's own findings, scored."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


def diagnosis(drawn: DrawnCases) -> None:
    """Hide effects in simulated flights, diagnose them, and count how often it is right.

    The flights come from a richer model than the candidates: parameters off
    nominal, noise that is not modelled, 30 Hz motion capture, with and without IMU
    and rotor speeds. Some hide pairs, some an effect that is not a candidate, some nothing.
    """
    from tombo_benchmarks.cli.scores import FLIGHTS, score_table
    from tombo_benchmarks.diagnosis.flight_evaluation import examine
    from tombo_benchmarks.diagnosis.score import score_of_flights

    show = partial(score_table, FLIGHTS)
    drawn.score("diagnosis", examine, score_of_flights, drawn.count(100), show, seed=drawn.seed)


def stand(drawn: DrawnCases) -> None:
    """Hide what can be wrong in simulated thrust-stand runs, and count how often it is found.

    The stands are richer than the candidates: everything off by tolerances, heavy
    tails, unknown shapes such as stall, friction, Reynolds number, resonance, creep.
    Four kinds of stand, from thrust alone to check loads and a second tachometer.
    """
    from tombo_benchmarks.cli.scores import STANDS, score_table
    from tombo_benchmarks.diagnosis.score import score_of_stands
    from tombo_benchmarks.diagnosis.stand_evaluation import examine

    show = partial(score_table, STANDS)
    drawn.score("stand", examine, score_of_stands, drawn.count(200), show, seed=drawn.seed)


@record
class _Foreign:
    folder: Path = argument("FOLDER", "Cases that rotorpy_flights.py has written.")


def foreign(given: _Foreign, scored: Scored) -> None:
    """Diagnose flights of rotorpy, a simulator by others, whose hidden cause is known.

    `other_environments/rotorpy_flights.py FOLDER` of this package flies them, with the Python of
    an environment that has rotorpy 3.0.0. Counted: right, in a set, wrong, withheld.
    """
    from tombo_benchmarks.diagnosis.foreign_flights import (
        aggregate,
        cases_in,
        examine,
        score_table,
    )

    cases = cases_in(given.folder)
    name = f"foreign {given.folder.resolve()}"
    scored.score(name, partial(examine, cases), aggregate, len(cases), score_table)


@record
class _InFlight:
    nodes: float | None = option(
        "--nodes S",
        "Kill or stop each node in flight; look at S seconds behind.",
        bounds=(1.0, 3600.0),
    )


def faults(drawn: DrawnCases, in_flight: _InFlight) -> None:
    """Check every fault, every pair in every phase, and N (1000) random sequences of faults.

    Mission, reaction and controller are those of the flight, around a point that flies
    (docs/faults.md). Counted: thrust after touchdown, take-offs without a command, set points
    that can't be followed or leave the flight volume, rotors that turn at the end.

    With --nodes the running suite hovers in real time, once for each node that is killed,
    killed and started again, or stopped for 20 s: a quarter of an hour for S = 60.
    """
    from tombo_benchmarks.cli.scores import fault_lines
    from tombo_benchmarks.faults.fault_benchmark import aggregate, enumerated, examine
    from tombo_benchmarks.faults.fault_flights import fly_faults

    nodes, fixed = in_flight.nodes, len(enumerated())

    def finish(found: BenchmarkResult, progress: Any, stop: Callable[[], bool]) -> BenchmarkResult:
        violated = [row for row in found.cases if row["violations"]]
        score = dict(found.aggregate)
        if nodes is not None:
            score["nodes"] = fly_faults(nodes, drawn.seed or 0, progress, stop)
        return replace(found, cases=violated, aggregate=score)

    drawn.score(
        "faults", partial(examine, fixed), partial(aggregate, fixed), fixed + drawn.count(1000),
        fault_lines, seed=drawn.seed, finish=finish,
    )  # fmt: skip


@record
class _Mutations:
    log: Path = argument("LOG", "A sound flight.")
    healthy: list[Path] | None = option(
        "--healthy OLD",
        "Another flight of the vehicle: what has changed since is asked, too. Once for each.",
    )


def mutations(given: _Mutations, known: VehicleName, reading: LogMapping, shown: Shown) -> None:
    """Damage a log in 22 ways, one at a time, and count how often `tombo diagnose` names it.

    Axes swapped, reversed, scaled, offset; units; motors swapped; samples late, frozen,
    dropped; a body defined turned; commands scaled. The log alone is asked, and with
    --vehicle and --healthy in these ways as well.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_benchmarks.diagnosis.mutations import ask_all, mutation_page
    from tombo_bringup.cli.progress import progress_bar
    from tombo_bringup.cli.tables import show_page
    from tombo_flight.vehicle_file import read_vehicle
    from tombo_logs.readers.log_reader import read_logs

    with progress_bar() as on_progress:
        flight, *others = read_logs([given.log, *(given.healthy or [])], mapping=reading.mapping)
        file = None if known.vehicle is None else read_vehicle(known.vehicle)
        answers = ask_all(flight, file, others, on_progress)
    show_page(mutation_page(flight.name, answers), shown.as_json)


@record
class _Load:
    seconds: float = option("--seconds S", "Fly so long.", 60.0, bounds=(4.0, 3600.0))
    busy: int = option("--busy N", "Beside N processes that never sleep.", 0, bounds=(0, 64))
    vehicles: int = option(
        "--vehicles N", "Hover with so many vehicles side by side.", 0, bounds=(0, 9)
    )


def nodes(load: _Load, shown: Shown) -> None:
    """Fly with all nodes in real time, and print how late each loop began its runs.

    An empty loop of 1 kHz, before and after the flight, shows how punctual the machine is.
    """
    from tombo_benchmarks.nodes.node_timing import fly_and_measure
    from tombo_bringup.cli.flight.node_tables import print_timing

    measured = fly_and_measure(load.seconds, load.busy, load.vehicles)
    if shown.as_json:
        print(json.dumps(measured, indent=1))
        return
    print_timing(measured)
    typer.echo(f"Too slow: {'; '.join(measured['too_slow']) or 'no'}")


@record
class _Real:
    data: Path | None = option(
        "--data DIR",
        "Folder with crazypad, crazyswarm2, air_garage, flights, nanobench_controllers; what is "
        "not there is left out. Default: shared/data beside the repository.",
    )
    few: int | None = option(
        "--few N", "At most N trials of each data set. Default: all.", bounds=(1, 1000)
    )


def real(given: _Real, scored: Scored) -> None:
    """Ask about real flights of known causes, and count right, wrong and withheld answers.

    Flights against healthy ones of the vehicle, single logs of mishaps, and healthy flights.
    With -o the page is written, too: same name, ending .html. A run that is stopped goes on
    with the same command.
    """
    most, output = given.few, scored.output
    if output is not None and output.suffix == ".html":
        raise InputError(
            f"-o '{output}': the page has that name; accepted: another ending, of JSON"
        )
    from tombo_benchmarks.real.real_benchmark import aggregate, examine
    from tombo_benchmarks.real.real_page import real_page
    from tombo_benchmarks.real.trials import ROOT, trials
    from tombo_flight.report.page import write_page

    folder = ROOT.parent / "shared" / "data" if given.data is None else given.data
    asked = trials(folder, most)

    def finish(found: BenchmarkResult, *_: object) -> BenchmarkResult:
        if output is not None:
            write_page(output.with_suffix(".html"), real_page(found))
        return found

    name = "real" if most is None else f"real --few {most}"
    scored.score(
        name, partial(examine, asked, folder), aggregate, len(asked), real_page, finish=finish
    )


@record
class _Rotorpy:
    rotorpy: Path = option(
        "--rotorpy PYTHON",
        "Python of an environment that has rotorpy 3.0.0 (`pip install rotorpy==3.0.0`).",
        ...,
    )

    def python(self) -> str:
        """Return the absolute path of a Python that has rotorpy.

        Raises:
            InputError: it does not run, or can't import rotorpy.
        """
        python = str(self.rotorpy.absolute())
        try:
            subprocess.run([python, "-c", "import rotorpy"], check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            raise InputError(
                f"--rotorpy '{self.rotorpy}' can't import rotorpy; accepted: the Python of an "
                "environment that has it (`python -m venv ENV; ENV/bin/pip install "
                "rotorpy==3.0.0`)"
            ) from None
        return python


def why(by: _Rotorpy, drawn: DrawnCases) -> None:
    """Crash flights of rotorpy by ten causes, and ask from one log each what and when it was.

    Times and sizes are drawn; sensors and channels of the logs differ.
    """
    from tombo_benchmarks.cli.scores import crash_table
    from tombo_benchmarks.why.crash_benchmark import aggregate, examine

    fly = partial(examine, by.python())
    drawn.score("why", fly, aggregate, drawn.count(200), crash_table, seed=drawn.seed)


BENCHMARKS: Final = (diagnosis, stand, foreign, faults, mutations, nodes, real, why)
"""In the order of the help."""
for _one in BENCHMARKS:
    command(app, _one.__name__, epilog=EXIT_CODES)(_one)
