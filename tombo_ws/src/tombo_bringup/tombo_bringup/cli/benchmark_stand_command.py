"""`tombo benchmark stand`: blind cases of the stand diagnosis, scored."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from tombo_bringup.cli.whole_number import whole_number

_ROWS: Final[tuple[tuple[str, str, str, float], ...]] = (
    ("top1_large", "right cause first, large", ">= 95 %", 0.95),
    ("top1_medium", "... medium", "", 0.0),
    ("top1_small", "... small", "", 0.0),
    ("answer_large", "... or in a set of six at most, large", "", 0.0),
    ("answer_medium", "... medium", "", 0.0),
    ("answer_small", "... small", "", 0.0),
    ("right_if_named", "right if named", "", 0.0),
    ("truth_in_set", "truth in the answered set", "", 0.0),
    ("mean_set_size", "mean size of the set", "", 0.0),
    ("false_alarm", "false alarm without an effect", "<= 5 %", 0.05),
    ("false_alarm_upper", "... upper bound, 95 %", "", 0.0),
    ("unknown_wrongly_named", "unknown cause wrongly named", "<= 2 %", 0.02),
    ("unknown_partly_explained", "... called partly explained", "", 0.0),
    ("unknown_missed", "... missed", "", 0.0),
    ("pair_both", "two causes: both", "", 0.0),
    ("pair_one", "... at least one", "", 0.0),
    ("parameter_error_median", "parameter error, median", "", 0.0),
    ("parameter_error_p90", "... 90 % below", "", 0.0),
    ("coverage_95", "95 % intervals that cover", "", 0.0),
    ("seconds_per_case", "seconds a case", "", 0.0),
)
_PLAIN: Final = ("mean_set_size", "seconds_per_case")
_STANDS: Final = ("full", "beta", "torque", "thrust")


def benchmark_stand(
    cases: Annotated[
        int,
        typer.Option("--cases", metavar="N", parser=whole_number, help="How many cases."),
    ] = 200,
    seed: Annotated[
        int,
        typer.Option("--seed", metavar="S", parser=whole_number, help="All chance comes from it."),
    ] = 0,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers", metavar="W", parser=whole_number, help="Processes. Default: one a core."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write the JSON there as well."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print cases and aggregate as JSON, and nothing else.")
    ] = False,
) -> None:
    """Hide what can be wrong in simulated thrust-stand runs, and count how often it is found.

    The stands are richer than the candidates: everything off by tolerances, heavy
    tails, unknown shapes such as stall, friction, Reynolds number, resonance, creep.
    Four kinds of stand, from thrust alone to check loads and a second tachometer.
    """
    from tombo_dynamics.errors import InputError

    for option, value, low, high in (
        ("--cases", cases, 1, 100_000),
        ("--seed", seed, 0, 2**63 - 1),
        ("--workers", 1 if workers is None else workers, 1, 1024),
    ):
        if not low <= value <= high:
            raise InputError(f"{option} {value}: out of bounds; accepted: {low} to {high}")
    if output is not None:
        _check_writable(output)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from tombo_bringup.cli.progress import progress_bar
    from tombo_bringup.flight_output import as_json as to_json
    from tombo_bringup.stand_blind.run import benchmark_stand as run
    from tombo_bringup.stop_signals import StopSignals

    count = (os.cpu_count() or 1) if workers is None else workers
    with StopSignals() as stop:
        with progress_bar() as tell:
            result = run(cases, seed, count, tell, stop.asked)
        if stop.asked():
            typer.echo("Error: interrupted", err=True)
            raise typer.Exit(stop.exit_code)
    text = to_json({"cases": result.cases, "aggregate": result.aggregate})
    if output is not None:
        try:
            output.write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise InputError(f"-o {output}: can't be written: {error.strerror}") from error
    if as_json:
        typer.echo(text, nl=False)
        return
    print_score(result.aggregate, len(result.cases))


def _check_writable(path: Path) -> None:
    """Try it, before hours of work: permissions alone do not tell (/proc, a full disk).

    Raises:
        InputError: it can't be written.
    """
    from tombo_dynamics.errors import InputError

    there = path.exists()
    try:
        with path.open("ab"):
            pass
        if not there:
            path.unlink()
    except OSError as error:
        raise InputError(
            f"-o {path}: can't be written ({error.strerror}); accepted: a file in a folder that "
            "can be written"
        ) from error


def print_score(aggregate: Mapping[str, Any], cases: int) -> None:
    """Print the score: all cases, then each kind of stand."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, title=Text(f"{cases} blind stand cases"), title_justify="left")
    for heading in ("", "asked for", "all", *_STANDS):
        table.add_column(heading, justify="left" if not heading else "right")
    parts = (aggregate, *(aggregate[s] for s in _STANDS))
    table.add_row("cases", "", *(str(p["cases"]) for p in parts))
    for key, words, asked, limit in _ROWS:
        cells = []
        for part in parts:
            value = part.get(key)
            text = "–"
            if value is not None:
                text = f"{value:.2f}" if key in _PLAIN else f"{100.0 * value:.1f} %"
            good = not asked or value is None or (value >= limit) == asked.startswith(">")
            cells.append(Text(text, "" if good or value == limit else "red"))
        table.add_row(Text(words), Text(asked), *cells)
    Console(highlight=False).print(table)
