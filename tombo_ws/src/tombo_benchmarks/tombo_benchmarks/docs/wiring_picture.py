"""The picture of the wiring in docs/architecture.md, drawn from the wiring itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

SIM = "sim"


class CoreType(Protocol):
    """What the picture needs of a core."""

    name: str
    inputs: tuple[str, ...]

    @property
    def outputs(self) -> Iterable[str]:
        """Topics that it publishes."""


def wiring_mermaid(cores: Sequence[CoreType], sensors: Iterable[str], command: str) -> str:
    """Return the flow chart: an arrow from each publisher to each subscriber, with its topics.

    Args:
        cores: the cores of a flight.
        sensors: topics that the simulator publishes and cores take.
        command: the topic that the simulator takes.
    """
    arrows: dict[tuple[str, str], list[str]] = {}

    def connect(topic: str, publisher: str, subscriber: str) -> None:
        arrows.setdefault((publisher, subscriber), []).append(topic.removeprefix("/"))

    publishers = {topic: core.name for core in cores for topic in core.outputs}
    publishers |= {topic: SIM for topic in sensors if topic not in publishers}
    for core in cores:
        for topic in core.inputs:
            if topic in publishers and publishers[topic] != core.name:
                connect(topic, publishers[topic], core.name)
    connect(command, publishers[command], SIM)
    lines = [f'    {a} -- "{"<br/>".join(topics)}" --> {b}' for (a, b), topics in arrows.items()]
    return "\n".join(["```mermaid", "flowchart LR", *lines, "```", ""])
