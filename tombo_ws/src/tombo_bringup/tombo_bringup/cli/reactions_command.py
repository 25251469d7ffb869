"""`tombo reactions`: what can be done about a collision, from the registry itself."""

from __future__ import annotations

import dataclasses
import inspect
import json
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli.options import JsonOnly

if TYPE_CHECKING:
    from tombo_collision.reactions import Reaction


def reactions(as_json: JsonOnly = False) -> None:
    """List every reaction to a collision, with its parameters and what it needs.

    `tombo fly --reaction NAME` chooses one, as `reaction: {name: NAME}` in a scenario file does;
    its parameters stand beside the name, or are --set as `reaction.KEY=VALUE`.
    """
    from tombo_collision.reactions import REGISTRY

    table = [_as_object(kind) for kind in REGISTRY.values()]
    if as_json:
        typer.echo(json.dumps(table, indent=1))
        return
    from tombo_bringup.cli.tables import print_parameters

    print_parameters("reaction", "default", table)


def _as_object(kind: type[Reaction]) -> dict[str, Any]:
    return {
        "name": kind.name,
        "doc": inspect.getdoc(kind) or "",
        "needs": list(kind.needs),
        "parameters": [
            {"name": f.name, "default": f.default}
            | {key: f.metadata.get(key) for key in ("unit", "bounds", "doc", "source")}
            for f in dataclasses.fields(kind)
        ],
    }
