"""The `tombo` command. What each subcommand needs is imported when it runs, so help is quick."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from typing import Final

import typer

from tombo_bringup.cli.errors import exit_code_of
from tombo_bringup.cli.options import HELP_OPTIONS, option, record, spelt_out

_COMMANDS: Final = (
    "flight.fly_command",
    "flight.sweep_command",
    "flight.up_command",
    "flight.call_command",
    "flight.graph_commands",
    "flight.px4_command",
    "flight.hil_command",
    "flight.mocap_command",
    "flight.replay_command",
    "live_command",
    "lab_command",
    "report_command",
    "workbench_command",
    "check_command",
    "first_flight_command",
    "compare_command",
    "diagnose_command",
    "why_command",
    "run_command",
    "catalogue_commands",
    "propeller.propeller_command",
    "vehicle_command",
)
"""Modules of this package; each has a Typer application `app` with its commands."""


_MORE: Final = (
    "Less often used, each with --help: tombo check mocap (mistakes of a motion capture), tombo "
    "hil (a real PX4 in SITL flies the simulated vehicle), tombo run (one node), tombo workbench "
    "(a propeller in the browser)."
)
"""Commands that the list of all does not show."""


def _print_version(wanted: bool) -> None:
    if wanted:
        from tombo_flight.version import tombo_version

        typer.echo(f"tombo {tombo_version()}")
        raise typer.Exit()


@record
class _Version:
    version: bool = option(
        "--version", "Print the version and leave.", False, check=_print_version, is_eager=True
    )


def _tombo(ctx: typer.Context, version: _Version) -> None:
    """Without a subcommand, say what there is."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


@cache
def application(modules: tuple[str, ...] = _COMMANDS) -> typer.Typer:
    """Return the command with the subcommands of modules; of all also those of other packages."""
    app = typer.Typer(
        name="tombo",
        help="Fly a quadrotor with Tombo propellers, which fold on impact: the collision "
        "experiment of the paper, headless.",
        epilog=_MORE,
        context_settings=HELP_OPTIONS,
        callback=spelt_out(_tombo),
        invoke_without_command=True,
        pretty_exceptions_enable=False,
    )
    for module in modules:
        app.add_typer(import_module(f"tombo_bringup.cli.{module}").app)
    if modules is _COMMANDS:
        from importlib.metadata import entry_points

        for command in sorted(entry_points(group="tombo.commands")):
            app.add_typer(command.load(), name=command.name, context_settings=HELP_OPTIONS)
    return app


def _modules_of(args: Sequence[str]) -> tuple[str, ...]:
    """Return the module of the subcommand that a command line begins with, else all."""
    names = {module.rpartition(".")[2]: module for module in _COMMANDS}
    module = names.get(f"{args[0].replace('-', '_')}_command") if args else None
    return _COMMANDS if module is None else (module,)


def run(arguments: Sequence[str] | None = None) -> None:
    """Run a command line, that of the process if None, and leave with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    args = list(sys.argv[1:] if arguments is None else arguments)
    sys.exit(exit_code_of(lambda: _command(args)))


def _command(args: list[str]) -> object:
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # as `tombo_bringup.start` leaves it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return application(_modules_of(args))(args, prog_name="tombo", standalone_mode=False)


if __name__ == "__main__":
    run()
