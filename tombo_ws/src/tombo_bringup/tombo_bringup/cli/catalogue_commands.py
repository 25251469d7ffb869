"""`tombo list`: what there is."""

from __future__ import annotations

import dataclasses
import inspect
from typing import TYPE_CHECKING, Any, Final

import typer

from tombo_bringup.cli.options import Imports, Shown, argument, command, record
from tombo_dynamics.errors import unknown_name

if TYPE_CHECKING:
    from tombo_collision.reactions import Reaction
    from tombo_dynamics.effects import Effect

app = typer.Typer()


@record
class _Kind:
    kind: str = argument("WHAT", "scenarios, effects or reactions.")


@command(app, "list")
def list_names(catalogue: _Kind, imports: Imports, shown: Shown) -> None:
    """List the scenarios, effects or reactions that there are, with their parameters.

    Your own scenario: tombo fly my_scenario.yaml, with `extends: paper_collision`.

    An effect is switched on by `effects.NAME.PARAMETER` in a scenario file or with --set. With all
    parameters at their null value it adds exactly nothing.

    `tombo fly --reaction NAME` chooses a reaction, as `reaction: {name: NAME}` in a scenario file
    does; its parameters follow the name, or are set by --set `reaction.KEY=VALUE`.
    """
    if catalogue.kind not in LISTS:
        raise unknown_name("list", catalogue.kind, LISTS)
    LISTS[catalogue.kind](shown.as_json)


def _scenarios(as_json: bool) -> None:
    from tombo_bringup.cli.tables import print_names
    from tombo_flight.builtin_files import builtin_scenarios

    own = "Your own file: tombo fly my_scenario.yaml, with `extends: paper_collision`."
    print_names(builtin_scenarios(), own, as_json)


def _effects(as_json: bool) -> None:
    from tombo_bringup.cli.tables import print_parameters
    from tombo_dynamics.effects import REGISTRY

    print_parameters("effect", "null", [_effect(e) for e in REGISTRY.values()], as_json)


def _reactions(as_json: bool) -> None:
    from tombo_bringup.cli.tables import print_parameters
    from tombo_collision.reactions import REGISTRY

    table = [_reaction(kind) for kind in REGISTRY.values()]
    print_parameters("reaction", "default", table, as_json)


LISTS: Final = {"scenarios": _scenarios, "effects": _effects, "reactions": _reactions}


def _effect(effect: Effect) -> dict[str, Any]:
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


def _reaction(kind: type[Reaction]) -> dict[str, Any]:
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
