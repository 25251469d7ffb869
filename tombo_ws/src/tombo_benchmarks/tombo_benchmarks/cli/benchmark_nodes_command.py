"""`tombo benchmark nodes`: how punctual the nodes are on this machine."""

from __future__ import annotations

import json

import typer

from tombo_bringup.cli.options import Shown, option, record


@record
class _Load:
    seconds: float = option("--seconds S", "Fly so long.", 60.0, bounds=(4.0, 3600.0))
    busy: int = option("--busy N", "Beside N processes that never sleep.", 0, bounds=(0, 64))


def benchmark_nodes(load: _Load, shown: Shown) -> None:
    """Fly with all nodes in real time, and print how late each loop began its runs.

    An empty loop of 1 kHz, before and after the flight, tells how punctual the machine is.
    """
    from tombo_benchmarks.nodes.node_timing import fly_and_measure
    from tombo_bringup.cli.tables import print_table
    from tombo_flight.report.page import Table
    from tombo_flight.suite.node_diagnostics import lateness_text

    measured = fly_and_measure(load.seconds, load.busy)
    if shown.as_json:
        print(json.dumps(measured, indent=1))
        return
    rows = [
        (
            name,
            f"{loop['rate_hz']:.3f}",
            *(lateness_text(loop[f"jitter_{share}_us"]) for share in ("p50", "p99")),
            str(loop["missed"]),
        )
        for name, loop in measured["loops"].items()
    ]
    print_table(Table(("loop", "rate [Hz]", "late, median", "late, 99 %", "missed"), rows))
    latency, recorder = measured["latency_gyro_to_command_us"], measured["recorder"]
    typer.echo(
        f"Gyro to command, across processes: {latency['p50']} us, 99 % {latency['p99']} us\n"
        f"Recorder: {recorder['messages']} messages, {recorder['lost']} lost\n"
        f"Too slow: {'; '.join(measured['too_slow']) or 'no'}"
    )
