"""The last diagnostics of each node, from `/diagnostics`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from tombo_dynamics.time_base import LATENESS_MAX_US

SILENT_S: Final = 3.0
"""A node that reports each second is called silent after this time."""
MOCAP_AGE: Final = "mocap_age_s"
"""Key of the age of the newest pose, in the report of the nodes that take poses."""


@dataclass(frozen=True)
class Loop:
    """A loop of a node, over its whole life.

    Attributes:
        name: as `rate loop`.
        metrics: all that the node says about it, numbers where they are some.
    """

    name: str
    metrics: Mapping[str, Any]

    def number(self, key: str) -> float:
        """Return a figure, NaN if it was not reported."""
        value = self.metrics.get(key)
        return float(value) if isinstance(value, int | float) else math.nan


@dataclass(frozen=True)
class Status:
    """The last report of a node.

    Attributes:
        level: 0 well, 1 warning, 2 error.
        message: what is wrong; empty if nothing is.
        values: figures by name, numbers where they are some.
        loops: its loops.
        heard_s: when it came, on the clock of who listens.
    """

    level: int = 0
    message: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    loops: tuple[Loop, ...] = ()
    heard_s: float = -math.inf


def lateness_text(late_us: float) -> str:
    """Return a percentile of the lateness for people: `140 us`, or `> 20 ms` if it was clipped."""
    if late_us >= LATENESS_MAX_US:
        return f"> {1e-3 * LATENESS_MAX_US:.0f} ms"
    return f"{late_us:.0f} us"


class NodeDiagnostics:
    """Collects reports; `nodes` has the last one of each node."""

    def __init__(self) -> None:
        self.nodes: dict[str, Status] = {}

    def take(self, report: Iterable[Mapping[str, Any]], heard_s: float) -> None:
        """Take in one report: the statuses of a DiagnosticArray.

        Args:
            report: each status with name (`NODE` or `NODE: LOOP`), level, message, values.
            heard_s: when it came; any clock that goes on.
        """
        heads: dict[str, Mapping[str, Any]] = {}
        loops: dict[str, list[Loop]] = {}
        for status in report:
            node, _, loop = str(status["name"]).partition(": ")
            if loop:
                loops.setdefault(node, []).append(Loop(loop, _numbers(status["values"])))
            else:
                heads[node] = status
        for node in {**heads, **loops}:
            head = heads.get(node, {})
            level = int(head.get("level", 0))
            self.nodes[node] = Status(
                level,
                str(head.get("message", "")) if level else "",
                _numbers(head.get("values", {})),
                tuple(loops.get(node, ())),
                heard_s,
            )

    @property
    def mocap_age_s(self) -> float:
        """Age of the newest pose as the node knows it that has it freshest; NaN: unknown."""
        ages = [status.values.get(MOCAP_AGE) for status in self.nodes.values()]
        return min((float(age) for age in ages if isinstance(age, int | float)), default=math.nan)


def _numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn texts that are numbers into numbers: whole ones into int."""
    return {str(key): _number(value) for key, value in values.items()}


def _number(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value
