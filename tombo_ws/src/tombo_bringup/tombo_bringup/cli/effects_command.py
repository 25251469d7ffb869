"""`tombo effects`: what the simulation can switch on, from the registry itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli.options import JsonOnly

if TYPE_CHECKING:
    from tombo_dynamics.effects import Effect


def effects(as_json: JsonOnly = False) -> None:
    """List every effect that a scenario can switch on, with its parameters.

    Each is set by `effects.NAME.PARAMETER` in a scenario file or with --set. With all parameters
    at their null value an effect adds exactly nothing.
    """
    from tombo_dynamics.effects import REGISTRY

    table = [_as_object(effect) for effect in REGISTRY.values()]
    if as_json:
        typer.echo(json.dumps(table, indent=1))
        return
    from tombo_bringup.cli.tables import print_parameters

    print_parameters("effect", "null", table)


def _as_object(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "stage": effect.stage.value,
        "doc": effect.doc,
        "signature": effect.signature,
        "parameters": [
            {key: getattr(p, key) for key in ("name", "unit", "null", "bounds", "doc")}
            for p in effect.theta
        ],
    }
