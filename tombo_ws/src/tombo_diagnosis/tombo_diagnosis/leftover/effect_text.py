"""The terms of a leftover as the source of an effect, ready to be pasted into the registry."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tombo_diagnosis.leftover.terms import FUNCTIONS, Term

NAME: Final = "leftover"
"""Of the effect."""
_AXES: Final = "xyz"
_STATE: Final = {
    ("x", "y", "z"): "plant.state.position",
    ("vx", "vy", "vz"): "plant.state.velocity",
    ("p", "q", "r"): "plant.state.rates",
    ("u", "v", "w"): "plant.airspeed",
    ("yaw",): "atan2(plant.rotation[1, 0], plant.rotation[0, 0])",
    ("thrust",): "plant.rotors[0].thrust",
    ("t",): "plant.ticks * plant.tick_length",
    ("voltage",): "plant.supply.voltage",
}
"""Variables of the terms → where an effect finds them."""


@dataclass(frozen=True)
class Contribution:
    """A term with its coefficient, as part of the force or of the moment."""

    quantity: str
    """force or moment."""
    term: Term
    value: float


def effect_text(parts: Sequence[Contribution]) -> str:
    """Return the module of an effect that adds these terms; empty without any.

    Its parameters are null where nothing is added, and typical as fitted.
    """
    if not parts:
        return ""
    names = [_identifier(part) for part in parts]
    params = [_param(name, part) for name, part in zip(names, parts, strict=True)]
    body = [*_variables(parts)]
    for quantity in dict.fromkeys(part.quantity for part in parts):
        body += _sums(quantity, [(n, p) for n, p in zip(names, parts, strict=True)
                                 if p.quantity == quantity])  # fmt: skip
    text = "\n".join(f"    {line}" for line in body)
    used = [f for f in ("atan2", *FUNCTIONS) if re.search(rf"\b{f}\(", text)]
    maths = f"from math import {', '.join(used)}\n\n" if used else ""
    turned = "from tombo_dynamics.rotation import to_body\n" if "to_body(" in text else ""
    arguments = "".join(f",\n    {name}: float" for name in names)
    signature = "; ".join(f"{p.quantity}: {p.term.name}" for p in parts)
    lines = textwrap.wrap(signature, 80, drop_whitespace=False)
    quoted = "\n    ".join(f'"{line}"' for line in lines)
    return (
        f'"""A force that diagnosed flights left over, as a sum of terms."""\n\n'
        f"{maths}from tombo_dynamics.arrays import Array\n"
        "from tombo_dynamics.effects.registry import Param, Stage, effect\n"
        f"from tombo_dynamics.plant import Plant\n{turned}\n\n"
        f'@effect(\n    "{NAME}",\n    Stage.WRENCH,\n    [\n'
        + "".join(f"        {line},\n" for line in params)
        + f"    ],\n    signature={quoted},\n)\n"
        f"def {NAME}(\n    plant: Plant,\n    noise: Array{arguments},\n) -> None:\n"
        f'    """Add what was fitted to flights; an exact cause is still to be found."""\n{text}\n'
    )


def _identifier(part: Contribution) -> str:
    return re.sub(r"\W+", "_", f"{part.quantity} {part.term.name}".removeprefix("force ")).lower()


def _param(name: str, part: Contribution) -> str:
    size = 10.0 ** math.ceil(math.log10(10.0 * max(abs(part.value), 1e-9)))
    unit = part.term.unit
    return (
        f'Param("{name}", "{unit}", 0.0, ({-size:g}, {size:g}), "{part.term.name}", '
        f"{part.value:.4g})"
    )


def _variables(parts: Sequence[Contribution]) -> list[str]:
    needed = {name for part in parts for name in part.term.variables}
    lines = []
    for names, source in _STATE.items():
        for i, name in enumerate(names):
            if name in needed:
                lines.append(f"{name} = {source}{f'[{i}]' if len(names) == 3 else ''}")
    return lines


def _sums(quantity: str, parts: Sequence[tuple[str, Contribution]]) -> list[str]:
    """Return the lines that add terms to one quantity of the plant."""
    lines = []
    for frame in ("map", "body"):
        own = [(name, part.term) for name, part in parts if part.term.frame == frame]
        if not own:
            continue
        added = [
            (i, name if text == "1.0" else f"{name} * ({text})")
            for name, term in own
            for i, text in enumerate(term.components)
            if text != "0.0"
        ]
        if frame == "body":
            lines += [f"plant.{quantity}[{i}] += {text}" for i, text in added]
            continue
        lines.append("map_x = map_y = map_z = 0.0")
        lines += [f"map_{_AXES[i]} += {text}" for i, text in added]
        lines.append("bx, by, bz = to_body(plant.rotation, (map_x, map_y, map_z))")
        lines += [f"plant.{quantity}[{i}] += b{a}" for i, a in enumerate(_AXES)]
    return lines
