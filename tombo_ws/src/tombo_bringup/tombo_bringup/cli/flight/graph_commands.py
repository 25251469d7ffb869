"""`tombo topic` and `tombo param`: topics and parameters of the running nodes."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import typer

from tombo_bringup.cli.options import Domain, Shown, argument, command, option, record
from tombo_dynamics.errors import InputError, unknown_name

app = typer.Typer()

_EXIT_CODES = "Exit code: 0; 1 when no message came or a value was refused; 2 for bad input."
_FOREVER_S = 1e9
_ARGUMENT_COUNTS = {"list": 1, "dump": 1, "get": 2, "set": 3}
"""Verb of `param` → number of words after it."""


@record
class _Topic:
    verb: str = argument("VERB", "list, echo or hz.")
    topic: str | None = argument("[TOPIC]", "Of echo and hz, as /odometry.", None)
    count: int = option("-n/--count N", "echo: leave after N messages; 0: go on.", 0)
    seconds: float = option("--seconds S", "hz: listen so long.", 5.0, bounds=(0.1, 3600.0))


@record
class _Parameter:
    verb: str = argument("VERB", "list, get, set or dump.")
    node: str = argument("NODE", "As mission.")
    name: str | None = argument("[NAME]", "Of get and set, as mission.height.", None)
    value: str | None = argument("[VALUE]", "Of set, in YAML.", None)


@command(app, hidden=True, epilog=_EXIT_CODES)
def topic(given: _Topic, domain: Domain, shown: Shown) -> None:
    """List the topics of the running nodes (`tombo up`), print messages, or measure their rate."""
    verb = given.verb
    if verb not in ("list", "echo", "hz"):
        raise unknown_name("verb", verb, ("list", "echo", "hz"))
    if (verb == "list") != (given.topic is None):
        raise InputError(f"{verb} {given.topic or ''}: accepted: list, echo TOPIC, hz TOPIC")
    seconds = _FOREVER_S if verb == "echo" else given.seconds
    become(("topic", verb, given.topic, given.count, seconds), domain, shown)


@command(app, hidden=True, epilog=_EXIT_CODES)
def param(given: _Parameter, domain: Domain, shown: Shown) -> None:
    """List, print or set parameters of a running node; dump writes a file for --params-file."""
    verb = given.verb
    if verb not in _ARGUMENT_COUNTS:
        raise unknown_name("verb", verb, _ARGUMENT_COUNTS)
    words = [word for word in (given.node, given.name, given.value) if word is not None]
    if len(words) != _ARGUMENT_COUNTS[verb]:
        raise InputError(
            f"{verb} {' '.join(words)}: accepted: list NODE, get NODE NAME, set NODE NAME VALUE, "
            "dump NODE"
        )
    become(("param", verb, *words), domain, shown)


def become(request: Sequence[Any], domain: Domain, shown: Shown) -> NoReturn:
    """Become the process that looks at the nodes."""
    from tombo_flight.suite.nodes import discovery_environment

    module = ["-m", "tombo_flight.suite.graph_node", json.dumps(request)]
    more = ["--json"] if shown.as_json else []
    sys.stdout.flush()
    environment = discovery_environment(os.environ, domain.domain)
    os.execve(sys.executable, [sys.executable, *module, *more], environment)
