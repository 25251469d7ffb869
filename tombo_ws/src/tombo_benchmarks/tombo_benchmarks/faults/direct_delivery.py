"""Compiled delivery without ticks, written out from the cores: a message is there at once.

For models with a clock of their own; `flight_loop` writes out the flight's from the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from tombo_dynamics.core import Core
from tombo_dynamics.jit import load_generated


def direct_delivery(cores: Sequence[type[Core]]) -> Any:
    """Return compiled functions that run cores.

    - `deliver_TOPIC(arguments, hearers, message, now)` hands a message to those that take it;
    - `step_CORE(arguments, now)` steps a core that has a step;
    - `publish_CORE(arguments, hearers, now)` delivers what of a core is due.

    `arguments` are those of each core (`Core.arguments`), `hearers` has bit c set if core c hears,
    `now` is in ns. In names a topic's slashes are underscores.

    Raises:
        TypeError: a core is not compiled.
    """
    text = _source(cores)
    return load_generated(f"tombo_delivery_{hashlib.sha256(text.encode()).hexdigest()[:12]}", text)


def _source(cores: Sequence[type[Core]]) -> str:
    imports = ["from tombo_dynamics.jit import compiled"]
    takers: dict[str, list[str]] = {}
    for c, core in enumerate(cores):
        for k, (topic, function) in enumerate(core.compiled_form().takes.items()):
            name = f"{core.name}_take_{k}"
            imports.append(f"from {function.__module__} import {function.__name__} as {name}")
            call = f"{name}(*arguments[{c}], message, now)"
            takers.setdefault(topic, []).extend([f"if hearers & {1 << c}:", f"    {call}"])
    lines = []
    for topic, calls in takers.items():
        lines += _function(f"deliver{_suffix(topic)}(arguments, hearers, message, now)", calls)
    for c, core in enumerate(cores):
        step, due = core.compiled_form().step, [f"memory = arguments[{c}][0]"]
        if step is not None:
            name = f"{core.name}_step"
            imports.append(f"from {step.__module__} import {step.__name__} as {name}")
            call = f"{name}(*arguments[{c}], now)"
            lines += _function(f"step_{core.name}(arguments, now)", [call])
        for topic, output in core.outputs.items():
            due.append(f"if memory.{output.due}:")
            if topic in takers:
                message = f"memory.{output.message}"
                due.append(f"    deliver{_suffix(topic)}(arguments, hearers, {message}, now)")
            due.append(f"    memory.{output.due} = False")
        lines += _function(f"publish_{core.name}(arguments, hearers, now)", due)
    return "\n".join([*imports, *lines, ""])


def _suffix(topic: str) -> str:
    return topic.replace("/", "_")


def _function(head: str, body: Sequence[str]) -> list[str]:
    return ["", "", "@compiled(inline=False)", f"def {head}:", *(f"    {line}" for line in body)]
