"""The `tombo` command. What each subcommand needs is imported when it runs, so help is quick."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Annotated

import typer

from tombo_bringup.cli.compare_command import COMPARE_EXIT_CODES, compare
from tombo_bringup.cli.diagnosis.diagnose_command import DIAGNOSE_EXIT_CODES, diagnose
from tombo_bringup.cli.diagnosis.many_paths import ManyPathsCommand
from tombo_bringup.cli.effects_command import effects
from tombo_bringup.cli.errors import exit_code_of
from tombo_bringup.cli.flight.arena_command import ARENA_EXIT_CODES, arena
from tombo_bringup.cli.flight.fly_command import EXIT_CODES, fly
from tombo_bringup.cli.flight.hil_command import HIL_EXIT_CODES, hil
from tombo_bringup.cli.flight.optional_url import OptionalUrlCommand
from tombo_bringup.cli.flight.px4_command import PX4_EXIT_CODES, px4
from tombo_bringup.cli.flight.replay_command import REPLAY_EXIT_CODES, replay
from tombo_bringup.cli.flight.risk_command import RISK_EXIT_CODES, risk
from tombo_bringup.cli.flight.sweep_command import SWEEP_EXIT_CODES, sweep
from tombo_bringup.cli.flight.up_command import UP_EXIT_CODES, up
from tombo_bringup.cli.options import option
from tombo_bringup.cli.propeller import propeller_command
from tombo_bringup.cli.reactions_command import reactions
from tombo_bringup.cli.run_command import PASS_ON, run_executable
from tombo_bringup.cli.runs_command import runs
from tombo_bringup.cli.scenarios_command import scenarios
from tombo_bringup.cli.vehicle_command import app as vehicle_app

_HELP = {"help_option_names": ["-h", "--help"]}
app = typer.Typer(
    name="tombo",
    help="Fly a quadrotor with Tombo propellers, which fold on impact: the collision experiment "
    "of the paper, headless.",
    context_settings=_HELP,
    pretty_exceptions_enable=False,
)
app.command(epilog=EXIT_CODES, cls=OptionalUrlCommand)(fly)
app.command(epilog=ARENA_EXIT_CODES)(arena)
app.command(epilog=UP_EXIT_CODES, cls=OptionalUrlCommand)(up)
app.command(epilog=PX4_EXIT_CODES)(px4)
app.command(epilog=HIL_EXIT_CODES)(hil)
app.command(epilog=REPLAY_EXIT_CODES)(replay)
app.command(epilog=COMPARE_EXIT_CODES)(compare)
app.command(epilog=DIAGNOSE_EXIT_CODES, cls=ManyPathsCommand)(diagnose)
app.command("run", context_settings=PASS_ON)(run_executable)
app.command(epilog=SWEEP_EXIT_CODES)(sweep)
app.command(epilog=RISK_EXIT_CODES)(risk)
app.command()(runs)
app.command()(scenarios)
app.add_typer(propeller_command.app, name="propeller", context_settings=_HELP)
app.add_typer(vehicle_app, name="vehicle", context_settings=_HELP)
app.command()(effects)
app.command()(reactions)
for command in sorted(entry_points(group="tombo.commands")):  # of other packages
    app.add_typer(command.load(), name=command.name, context_settings=_HELP)


def _print_version(wanted: bool) -> None:
    if wanted:
        from tombo_flight.version import tombo_version

        typer.echo(f"tombo {tombo_version()}")
        raise typer.Exit()


@app.callback(invoke_without_command=True)
def tombo(
    ctx: typer.Context,
    version: Annotated[
        bool,
        option(
            "--version", "Print the version and leave.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Without a subcommand, say what there is."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


def run(arguments: Sequence[str] | None = None) -> None:
    """Run a command line, that of the process if None, and leave with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    args = None if arguments is None else list(arguments)
    sys.exit(exit_code_of(lambda: _command(args)))


def _command(args: list[str] | None) -> object:
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # as `tombo_bringup.start` leaves it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return app(args, prog_name="tombo", standalone_mode=False)


if __name__ == "__main__":
    run()
