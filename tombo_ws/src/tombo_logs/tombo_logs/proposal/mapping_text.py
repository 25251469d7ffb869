"""A proposal as the text of a mapping file, with the reasons as comments."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Sequence

from tombo_bag.flight import Airframe
from tombo_logs.proposal.propose import Line, Proposal

_PLAIN = re.compile(r"-?[A-Za-z_/][\w./^%-]*")
_WORDS = {"yes", "no", "on", "off", "true", "false", "null", "y", "n"}
_WIDTH = 96


def mapping_text(
    proposal: Proposal, source: str, remarks: Sequence[str], airframe: Airframe | None
) -> str:
    """Return a mapping file.

    Args:
        proposal: what it says.
        source: name of the file that it was made from.
        remarks: to stand at its head.
        airframe: of the vehicle, where the names tell which it is.
    """
    lines = [*_comment(f"Proposed for {source}. Look at the lines marked DOUBTFUL.")]
    for text in proposal.notes:
        lines += _comment(f"Not used: {text}.")
    for text in remarks:
        lines += _comment(text)
    lines.append(f"about: proposed for {_scalar(source)}")
    for line in proposal.top:
        lines += _entry(line, "")
    lines.append("channels:" if proposal.channels else "channels: {}")
    for line in proposal.channels:
        lines += _entry(line, "  ")
    return "\n".join([*lines, *_vehicle(airframe)]) + "\n"


def _entry(line: Line, indent: str) -> Iterable[str]:
    yield from _comment(line.why, indent)
    if line.doubt:
        yield from _comment(f"DOUBTFUL: {line.doubt}", indent)
    value = line.content.get("")
    if value is None:
        pairs = ", ".join(f"{key}: {_scalar(item)}" for key, item in line.content.items())
        value_text = f"{{{pairs}}}"
    else:
        value_text = _scalar(value)
    yield f"{indent}{line.key}: {value_text}"


def _vehicle(airframe: Airframe | None) -> Iterable[str]:
    if airframe is None:
        yield from _comment(
            "The vehicle: with --vehicle, or stated here; without it the suite's S500 is assumed:"
        )
        yield "# airframe: {name: mine, mass: 1.2, arm_length: 0.225, rotor_radius: 0.12}"
        return
    yield from _comment("DOUBTFUL: the names are a Crazyflie's; weigh yours, decks included")
    yield (
        f"airframe: {{name: {airframe.name}, mass: {airframe.mass}, arm_length: "
        f"{airframe.arm_length}, rotor_radius: {airframe.rotor_radius},\n"
        f"  inertia: {_scalar(list(airframe.inertia or ()))}, motor_time_constant: "
        f"{airframe.motor_time_constant}}}"
    )


def _comment(text: str, indent: str = "") -> list[str]:
    plain = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return textwrap.wrap(
        plain, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _scalar(value: object) -> str:
    """Return a value as YAML; a name that could be read as something else in quotes."""
    if isinstance(value, list):
        return f"[{', '.join(_scalar(item) for item in value)}]"
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS
        return value if plain else json.dumps(value, ensure_ascii=False)
    return f"{value:g}" if isinstance(value, float) else str(value)
