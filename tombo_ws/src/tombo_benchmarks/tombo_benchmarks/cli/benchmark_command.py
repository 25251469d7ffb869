"""`tombo benchmark`: blind tests of what the suite claims to find out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import typer

from tombo_benchmarks.cli.benchmark_faults_command import benchmark_faults
from tombo_benchmarks.cli.benchmark_foreign_command import benchmark_foreign
from tombo_benchmarks.cli.benchmark_mutations_command import benchmark_mutations
from tombo_benchmarks.cli.benchmark_nodes_command import benchmark_nodes
from tombo_benchmarks.cli.benchmark_real_command import benchmark_real
from tombo_benchmarks.cli.benchmark_run import EXIT_CODES, DrawnCases, print_benchmark
from tombo_benchmarks.cli.benchmark_stand_command import benchmark_stand
from tombo_benchmarks.cli.benchmark_why_command import benchmark_why
from tombo_bringup.cli.options import command, option, record
from tombo_dynamics.errors import InputError

app = typer.Typer()


@record
class _Hidden:
    scenario: str = option(
        "--scenario NAME", "Fly this scenario, or file, in place of random courses.", ""
    )
    effects: str = option(
        "--effects LIST", "With --scenario: names with commas between, or all.", "all"
    )


@app.callback(invoke_without_command=True)
def benchmark(ctx: typer.Context) -> None:
    """Blind tests of the suite's own findings, scored."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


@command(app, "diagnosis", epilog=EXIT_CODES)
def diagnosis(drawn: DrawnCases, hidden: _Hidden) -> None:
    """Hide effects in simulated flights, diagnose them, and count how often it is right.

    The flights come from a richer model than the candidates: parameters off
    nominal, noise that is not modelled, 30 Hz motion capture, with and without IMU
    and rotor speeds. Some hide pairs, some what is no candidate, some nothing.
    With --scenario one effect at a time is hidden in that flight, in turn of
    medium, large and small size.
    """
    from tombo_benchmarks.diagnosis.flight_evaluation import benchmark, scenario_benchmark

    name, scenario, effects = "diagnosis", hidden.scenario, hidden.effects
    run: Callable[..., Any] = benchmark
    if scenario:
        name += f" --scenario {scenario} --effects {effects}"
        run = scenario_benchmark(scenario, effects)
    elif effects != "all":
        raise InputError(f"--effects {effects}: needs --scenario; accepted: all")
    drawn.score_drawn(name, run, 100, print_benchmark)


command(app, "stand", epilog=EXIT_CODES)(benchmark_stand)
command(app, "foreign", epilog=EXIT_CODES)(benchmark_foreign)
command(app, "faults", epilog=EXIT_CODES)(benchmark_faults)
command(app, "mutations")(benchmark_mutations)
command(app, "nodes")(benchmark_nodes)
command(app, "real", epilog=EXIT_CODES)(benchmark_real)
command(app, "why", epilog=EXIT_CODES)(benchmark_why)
