"""`tombo benchmark`: blind tests of what the suite claims to find out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from tombo_benchmarks.cli.benchmark_faults_command import FAULT_EXIT_CODES, benchmark_faults
from tombo_benchmarks.cli.benchmark_foreign_command import benchmark_foreign
from tombo_benchmarks.cli.benchmark_mutations_command import benchmark_mutations
from tombo_benchmarks.cli.benchmark_nodes_command import benchmark_nodes
from tombo_benchmarks.cli.benchmark_real_command import benchmark_real
from tombo_benchmarks.cli.benchmark_run import (
    EXIT_CODES,
    AsJson,
    Cases,
    Output,
    checked,
    print_benchmark,
    run_and_print,
)
from tombo_benchmarks.cli.benchmark_stand_command import benchmark_stand
from tombo_benchmarks.cli.benchmark_why_command import benchmark_why
from tombo_bringup.cli.options import Seed, Workers, option
from tombo_dynamics.errors import InputError

app = typer.Typer()

HiddenIn = Annotated[
    str, option("--scenario NAME", "Fly this scenario, or file, in place of random courses.")
]
HiddenEffects = Annotated[
    str, option("--effects LIST", "With --scenario: names with commas between, or all.")
]


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
    from tombo_benchmarks.diagnosis.flight_evaluation import benchmark, scenario_benchmark

    name = "diagnosis"
    run: Callable[..., Any] = benchmark
    if scenario:
        name += f" --scenario {scenario} --effects {effects}"
        run = scenario_benchmark(scenario, effects)
    elif effects != "all":
        raise InputError(f"--effects {effects}: needs --scenario; accepted: all")
    run_and_print(name, run, cases, seed, count, output, as_json, print_benchmark)


app.command("stand", epilog=EXIT_CODES)(benchmark_stand)
app.command("foreign", epilog=EXIT_CODES)(benchmark_foreign)
app.command("faults", epilog=FAULT_EXIT_CODES)(benchmark_faults)
app.command("mutations")(benchmark_mutations)
app.command("nodes")(benchmark_nodes)
app.command("real", epilog=EXIT_CODES)(benchmark_real)
app.command("why", epilog=EXIT_CODES)(benchmark_why)
