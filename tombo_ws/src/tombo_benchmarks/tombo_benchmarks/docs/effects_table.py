"""The page about all effects, `docs/effects.md`, written from the registry."""

from __future__ import annotations

from tombo_dynamics.effects import REGISTRY, Effect, Param, Stage

STAGES: dict[Stage, str] = {
    Stage.BODY: "Once, before the flight: mass, balance, drives",
    Stage.AIR: "Each tick: the air's motion",
    Stage.ROTOR: "Each tick: what rotors give",
    Stage.COMMAND: "Each tick: what drives are asked for",
    Stage.WRENCH: "Each evaluation of the dynamics: forces on the body",
    Stage.IMU: "Each tick: gyro and accelerometer",
    Stage.MOCAP: "Each sample: motion capture",
}
"""Heading of each stage, in the order of a tick."""

_HEAD = """\
<!-- Written by `make docs ARGS=tables` from the registry. Do not edit. -->
# Effects

Deviations from the nominal model. The simulation can switch them on, the diagnosis can fit them.
Switch one on in a scenario (`effects: {steady_wind: {east: 2.0}}`) or by
`--set effects.steady_wind.east=2`. A parameter that is not given has its *null*
value; with all of its parameters at null an effect adds exactly nothing. *Typical* is a size
that clearly matters in flight.

`blade_strike`, `propeller_wear` and `thrust_scatter` are filled in from the chosen propeller
(its figures of the paper's Table III, and how well the set is matched), unless the scenario
says otherwise.
"""


def effects_markdown() -> str:
    """Return the page as Markdown: the effects by stage, with parameters and how each shows."""
    parts = [_HEAD]
    for stage, heading in STAGES.items():
        found = [entry for entry in REGISTRY.values() if entry.stage is stage]
        if found:
            parts.append(f"## {heading}\n")
            parts.extend(_section(entry) for entry in found)
    return "\n".join(parts)


def _section(entry: Effect) -> str:
    lines = [f"### `{entry.name}`", entry.doc, ""]
    lines += ["| parameter | unit | null | bounds | typical | what |", "|---|---|---|---|---|---|"]
    lines += [_row(p) for p in entry.theta]
    lines += ["", f"Shows as: {entry.signature}."]
    for other, manoeuvre in entry.separates_from.items():
        lines.append(f"Distinguished from `{other}` by: {manoeuvre}.")
    return "\n".join(lines) + "\n"


def _row(p: Param) -> str:
    low, high = p.bounds
    bounds = f"{low:g} to {high:g}"
    return f"| `{p.name}` | {p.unit} | {p.null:g} | {bounds} | {p.typical:g} | {p.doc} |"
