"""`tombo benchmark faults`: whether any sequence of faults ends in what must not be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import typer

from tombo_benchmarks.cli.benchmark_run import DrawnCases
from tombo_bringup.cli.options import option, record
from tombo_dynamics.errors import InputError

_FEWEST_S, _MOST_S = 1.0, 3600.0


@record
class _InFlight:
    flights: int = option(
        "--flights N",
        "Fly each scenario N times: does the touchdown test fire?",
        0,
        bounds=(0, 10_000),
    )
    nodes: float = option(
        "--nodes S",
        "Kill or stop each node in flight; look at S seconds behind.",
        0.0,
        accepted=f"0, or {_FEWEST_S:g} to {_MOST_S:g}",
    )


def benchmark_faults(drawn: DrawnCases, in_flight: _InFlight) -> None:
    """Check every fault, every pair in every phase, and N (1000) random sequences of faults.

    Mission, reaction and controller are those of the flight, around a point that flies
    (docs/faults.md). Counted: thrust after touchdown, take-offs without a command, set points
    that can't be followed or leave the flight volume, rotors that turn at the end.

    With --nodes the running suite hovers in real time, once for each node that is killed,
    killed and started again, or stopped for 20 s: a quarter of an hour for S = 60.
    """
    from tombo_benchmarks.faults.fault_benchmark import check_faults, touchdown_in_flight
    from tombo_benchmarks.faults.fault_flights import fly_faults

    flights, nodes = in_flight.flights, in_flight.nodes
    if nodes and not _FEWEST_S <= nodes <= _MOST_S:
        accepted = f"0, or {_FEWEST_S:g} to {_MOST_S:g}"
        raise InputError(f"--nodes {nodes:g}: out of bounds; accepted: {accepted}")

    def run(
        cases: int, seed: int, workers: int, progress: Callable[..., Any],
        stop: Callable[[], bool], kept: Any,
    ) -> Any:  # fmt: skip
        found = check_faults(cases, seed, workers, progress, stop)
        more: dict[str, Any] = {}
        if flights and not stop():
            more["touchdown_in_flight"] = touchdown_in_flight(flights, workers, progress, stop)
        if nodes and not stop():
            more["nodes"] = fly_faults(nodes, seed, progress, stop)
        return replace(found, aggregate={**found.aggregate, **more})

    drawn.score_drawn("faults", run, 1000, _show)


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
    for row in aggregate.get("nodes", []):
        typer.echo(_behind(row))


def _behind(row: Mapping[str, Any]) -> str:
    """Return what a vehicle did behind a fault of a node, as a line."""
    text = f"{row['fault']}: {row['ends']}, drift {row['drift_m']:.2f} m"
    if row["down_s"] is not None:
        off = row["rotors_off_s"]
        text += (
            f", sinks at {row['sink_m_s']:.2f} m/s, down after {row['down_s']:.1f} s, rotors off "
            f"{'never' if off is None else f'{off:.1f} s later'}, slides {row['slid_m']:.2f} m"
        )
    return text + (", FLIES AGAIN" if row["flew_again"] else "")
