"""`tombo benchmark faults`: whether any sequence of faults ends in what must not be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Final

import typer

from tombo_bringup.cli.diagnosis.benchmark_run import (
    AsJson,
    Cases,
    Output,
    Workers,
    checked,
    run_and_print,
)
from tombo_bringup.cli.options import Seed, integer_option
from tombo_dynamics.errors import InputError

FAULT_EXIT_CODES: Final = (
    "Exit code: 0 whatever is found; 2 for bad input or output that can't be written; 130 after "
    "Ctrl-C."
)
_MOST_FLIGHTS: Final = 10_000


def benchmark_faults(
    cases: Cases = 1000,
    flights: Annotated[
        int,
        integer_option("--flights N", "Fly each scenario N times: does the touchdown test fire?"),
    ] = 0,
    seed: Seed = 0,
    workers: Workers = None,
    output: Output = None,
    as_json: AsJson = False,
) -> None:
    """Check every fault, every pair in every phase, and N random sequences of faults.

    Mission, reaction and controller are those of the flight, around a point that flies
    (docs/safety.md). Counted: thrust after touchdown, take-offs without a command, set points
    that can't be followed or leave the flight volume, rotors that turn at the end.
    """
    from tombo_flight.fault_benchmark import check_faults, touchdown_in_flight

    if not 0 <= flights <= _MOST_FLIGHTS:
        raise InputError(f"--flights {flights}: out of bounds; accepted: 0 to {_MOST_FLIGHTS}")
    count = checked(cases, workers, output)

    def run(
        cases: int, seed: int, workers: int, progress: Callable[..., Any],
        stop: Callable[[], bool], kept: Any,
    ) -> Any:  # fmt: skip
        found = check_faults(cases, seed, workers, progress, stop)
        if not flights or stop():
            return found
        aloft = touchdown_in_flight(flights, workers, progress, stop)
        return replace(found, aggregate={**found.aggregate, "touchdown_in_flight": aloft})

    run_and_print(run, cases, seed, count, output, as_json, _show)


def _show(aggregate: Mapping[str, Any], violating: int) -> None:
    typer.echo(
        f"{aggregate['enumerated']} single faults and pairs in every phase, "
        f"{aggregate['random']} random sequences: {aggregate['violations']} with a violation"
    )
    for kind, number in aggregate["by_kind"].items():
        typer.echo(f"  {kind}: {number}")
    longest, unused = aggregate["longest_ground_s"], aggregate["rows_unused"]
    typer.echo(f"Rotors on at the ground in a descent: at most {longest:.1f} s")
    typer.echo(f"Transitions taken: {aggregate['rows_used']}; not: {', '.join(unused) or 'none'}")
    for name, one in aggregate.get("touchdown_in_flight", {}).items():
        typer.echo(
            f"{name}: touchdown test fired in {one['fired']} of {one['flights']} flights; longest "
            f"contact in the air {one['longest_contact_s']:.3f} s"
        )
