"""`tombo benchmark`: blind tests of what the suite claims to find out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final

import typer

from tombo_bringup.cli.diagnosis.benchmark_faults_command import FAULT_EXIT_CODES, benchmark_faults
from tombo_bringup.cli.diagnosis.benchmark_foreign_command import benchmark_foreign
from tombo_bringup.cli.diagnosis.benchmark_run import (
    EXIT_CODES,
    AsJson,
    Cases,
    Output,
    checked,
    run_and_print,
)
from tombo_bringup.cli.diagnosis.benchmark_stand_command import benchmark_stand
from tombo_bringup.cli.options import Seed, Workers, option
from tombo_dynamics.errors import InputError

app = typer.Typer()

HiddenIn = Annotated[
    str, option("--scenario NAME", "Fly this scenario, or file, in place of random courses.")
]
HiddenEffects = Annotated[
    str, option("--effects LIST", "With --scenario: names with commas between, or all.")
]

THRESHOLDS: Final[tuple[tuple[str, str, str, float, float], ...]] = (
    ("top1_large", "right cause first, large effect", ">=", 0.97, 100.0),
    ("top1_medium", "right cause first, medium effect", ">=", 0.85, 100.0),
    ("top1_small", "right cause first, small effect", ">=", 0.65, 100.0),
    ("another_named", "another cause named than the one that is there", "<=", 0.05, 100.0),
    ("unseen_named", "something named where nothing can be seen", "<=", 0.05, 100.0),
    ("right_if_named", "right if named", ">=", 0.98, 100.0),
    ("truth_in_set", "truth in the answered set", ">=", 0.99, 100.0),
    ("mean_set_size", "mean size of the set", "<=", 2.0, 1.0),
    ("false_alarm", "false alarm without an effect", "<=", 0.05, 100.0),
    ("unknown_wrongly_named", "unknown cause wrongly named", "<=", 0.02, 100.0),
    ("parameter_error_median", "parameter error, median", "<=", 0.02, 100.0),
    ("parameter_error_p90", "parameter error, 90 % below", "<=", 0.10, 100.0),
    ("coverage_95", "95 % intervals that cover the truth", "90-98 %", 0.90, 100.0),
    ("seconds_per_case", "run time of a case [s]", "<=", 5.0, 1.0),
)
"""Key of the aggregate, words, what is asked for, the figure, factor to what is shown."""
_COVERAGE_MOST: Final = 0.98


@app.callback(invoke_without_command=True)
def benchmark(ctx: typer.Context) -> None:
    """Blind tests of the suite's own findings, scored."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


@app.command("diagnosis", epilog=EXIT_CODES)
def diagnosis(
    cases: Cases = 100,
    seed: Seed = 0,
    workers: Workers = None,
    output: Output = None,
    as_json: AsJson = False,
    scenario: HiddenIn = "",
    effects: HiddenEffects = "all",
) -> None:
    """Hide effects in simulated flights, diagnose them, and count how often it is right.

    The flights come from a richer model than the candidates: parameters off
    nominal, noise that is not modelled, 30 Hz motion capture, with and without IMU
    and rotor speeds. Some hide pairs, some what is no candidate, some nothing.
    With --scenario one effect at a time is hidden in that flight, in turn of
    medium, large and small size.
    """
    count = checked(cases, workers, output)
    from tombo_diagnosis.benchmark.flight_evaluation import benchmark, scenario_benchmark

    name = "diagnosis"
    run: Callable[..., Any] = benchmark
    if scenario:
        name += f" --scenario {scenario} --effects {effects}"
        run = scenario_benchmark(scenario, effects)
    elif effects != "all":
        raise InputError(f"--effects {effects}: needs --scenario; accepted: all")
    run_and_print(name, run, cases, seed, count, output, as_json, print_benchmark)


def print_benchmark(aggregate: Mapping[str, Any], cases: int) -> None:
    """Print the score against what is asked for; sets of cases on their own one by one."""
    from tombo_bringup.cli.tables import console

    out = console(highlight=False)
    out.print(_table(aggregate, f"{cases} synthetic cases"))
    for name, part in aggregate.items():
        if isinstance(part, Mapping) and any(key in part for key, *_ in THRESHOLDS):
            out.print(_table(part, name.replace("_", " ")))


def _table(aggregate: Mapping[str, Any], title: str) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    from tombo_bringup.cli.tables import right

    columns = right("found", "asked for")
    table = Table("", *columns, "", box=SIMPLE_HEAD, title=Text(title), title_justify="left")
    for key, words, sign, limit, factor in THRESHOLDS:
        value = aggregate.get(key)
        asked = sign if sign not in (">=", "<=") else f"{sign} {_shown(limit, factor)}"
        good = meets(key, value)
        mark = Text("–") if good is None else Text("yes" if good else "no", "" if good else "red")
        table.add_row(Text(words), "–" if value is None else _shown(value, factor), asked, mark)
    return table


def meets(key: str, value: float | None) -> bool | None:
    """Return whether a figure of the aggregate is as asked for; None: there is none."""
    if value is None or value != value:
        return None
    if key == "coverage_95":
        return 0.90 <= value <= _COVERAGE_MOST
    sign, limit = next((sign, limit) for name, _, sign, limit, _ in THRESHOLDS if name == key)
    return value >= limit if sign == ">=" else value <= limit


def _shown(value: float, factor: float) -> str:
    return f"{factor * value:.1f} %" if factor == 100.0 else f"{value:.2f}"


app.command("stand", epilog=EXIT_CODES)(benchmark_stand)
app.command("foreign", epilog=EXIT_CODES)(benchmark_foreign)
app.command("faults", epilog=FAULT_EXIT_CODES)(benchmark_faults)
