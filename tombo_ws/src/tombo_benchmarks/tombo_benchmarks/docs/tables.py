"""Tables of the documentation: nodes, topics, safety states, faults, effects, claims, wiring.

Topics come from `tombo_bag.topics`; the rest of the nodes is read from their sources, which are
never imported.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from tombo_bag import topics
from tombo_bag.qos import Qos
from tombo_bag.topics import CLOCK, DIAGNOSTICS, TOPICS, TopicSpec
from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.faults.fault_model import Fault
from tombo_bringup.first_flight.steps import printed_steps
from tombo_control.safety.state_machine import TABLE, SafetyState
from tombo_dynamics.core import Core
from tombo_dynamics.effect_registry import HEALTHY_SPREAD
from tombo_dynamics.effects import REGISTRY, Effect, Stage
from tombo_dynamics.errors import InputError
from tombo_flight.suite.nodes import PX4_SUITE, SUITE
from tombo_propeller.reproduce.page import KINDS, computed_text, verdict_text
from tombo_propeller.reproduce.reproduction import GROUPS, Reproduction, checks_summary, headline
from tombo_sim.wiring import CORES, OPERATOR


@dataclass(frozen=True)
class NodeFacts:
    """Facts about a node, from its source.

    Attributes:
        name: of the node.
        package: it is in.
        rate_hz: of its loop.
        publishes: names of the topics it publishes.
        subscribes: names of the topics it takes.
    """

    name: str
    package: str
    rate_hz: float
    publishes: frozenset[str]
    subscribes: frozenset[str]


CORE_NODE = "tombo_ros.core_node"
PAGES = {
    "nodes.md": ("nodes", "topics"),
    "safety.md": ("states", "transitions"),
    "faults.md": ("faults",),
    "first_real_flight.md": ("first_flight",),
}
"""Page → its tables."""


def read_nodes(suite: Mapping[str, str] = SUITE) -> list[NodeFacts]:
    """Return the facts of every node of a suite, name → module."""
    return [_facts(name, module) for name, module in suite.items()]


def every_node() -> list[NodeFacts]:
    """Return the facts of the nodes of both suites, without and with PX4."""
    more = {name: module for name, module in PX4_SUITE.items() if name not in SUITE}
    return read_nodes({**SUITE, **more})


def _facts(name: str, module: str) -> NodeFacts:
    """Return the facts of a node: of its core, if it hosts one, and what its source adds."""
    tree, package = _source(module), module.partition(".")[0]
    published, subscribed = (_topic_names(tree, method) for method in ("advertise", "subscribe"))
    for core in CORES:
        if core.name == name:
            rates = [
                float(ast.literal_eval(keyword.value))
                for keyword in ast.walk(tree)
                if isinstance(keyword, ast.keyword) and keyword.arg == "rate_hz"
            ]
            rate_hz = rates[0] if rates else 1e9 / core.period_ns
            return NodeFacts(
                name, package, rate_hz, published | {*core.outputs}, frozenset(core.inputs)
            )
    begin = next(call for call in _calls(tree, "__init__") if len(call.args) > 1)
    return NodeFacts(name, package, float(_value(tree, begin.args[1])), published, subscribed)


def _source(module: str) -> ast.Module:
    """Return the source of a node, behind those of the nodes that it is made from."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise InputError(f"module {module}: not found; accepted: one that is there")
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    bases = [
        node.module
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        and node.module
        and node.module.endswith("_node")
        and node.module != CORE_NODE
    ]
    body = [statement for base in bases for statement in _source(base).body]
    return ast.Module([*body, *tree.body], [])


def _calls(tree: ast.AST, method: str) -> list[ast.Call]:
    """Return the calls of a method of any object, in the order of the source."""
    body = tree.body if isinstance(tree, ast.Module) else [tree]
    found = []
    for statement in body:
        calls = [
            node
            for node in ast.walk(statement)
            if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == method
            and node.args
        ]
        found += sorted(calls, key=lambda call: call.lineno)
    return found


def _topic_names(tree: ast.AST, method: str) -> frozenset[str]:
    """Return the topics that a method is called with."""
    specs = (getattr(topics, ast.unparse(call.args[0]), None) for call in _calls(tree, method))
    return frozenset(spec.name for spec in specs if isinstance(spec, TopicSpec))


def _value(tree: ast.AST, value: ast.expr) -> str:
    """Return a constant's text; a name is looked up."""
    if isinstance(value, ast.Name):
        value = next(
            node.value
            for node in ast.walk(tree)
            if isinstance(node, ast.Assign) and value.id in map(ast.unparse, node.targets)
        )
    return str(ast.literal_eval(value))


def node_table(nodes: list[NodeFacts]) -> str:
    """Return the table of nodes as Markdown."""
    rows = [(f"`{n.name}`", f"`{n.package}`", f"{n.rate_hz:g} Hz") for n in nodes]
    return table_markdown(("node", "package", "loop"), rows)


def topic_table(nodes: list[NodeFacts]) -> str:
    """Return the table of topics as Markdown."""
    rows = []
    for spec in TOPICS.values():
        package, _, name = spec.typename.split("/")
        rate = f"{spec.rate_hz:g} Hz" if spec.rate_hz else "event"
        flow = _flow(spec, nodes)
        rows.append(
            (f"`{spec.name}`", f"{package}/{name}", rate, _quality(spec.qos), flow, spec.doc)
        )
    return table_markdown(("topic", "type", "rate", "QoS", "from → to", "what"), rows)


def _quality(qos: Qos) -> str:
    held = ", latched" if qos.durability == "transient_local" else ""
    return f"{qos.reliability.replace('_', ' ')}{held}, {qos.depth}"


def _flow(spec: TopicSpec, nodes: list[NodeFacts]) -> str:
    if spec == CLOCK:
        return "sim → all"
    if spec == DIAGNOSTICS:
        return "all"
    publishers = [node.name for node in nodes if spec.name in node.publishes]
    publishers += ["operator"] if spec.name in OPERATOR else []
    subscribers = [node.name for node in nodes if spec.name in node.subscribes]
    return (
        f"{', '.join(publishers)} → {', '.join(subscribers)}"
        if subscribers
        else ", ".join(publishers)
    )


def tables(page: str = "nodes.md") -> dict[str, str]:
    """Return the tables of a page by the names of their markers."""
    nodes = every_node()
    found = {
        "nodes": node_table(nodes),
        "topics": topic_table(nodes),
        "first_flight": table_markdown(("step", "you", "machine", "if it fails"), printed_steps()),
        **safety_tables(),
    }
    return {name: found[name] for name in PAGES[page]}


def safety_tables() -> dict[str, str]:
    """Return the tables of docs/safety.md and docs/faults.md by the names of their markers."""
    states = [(f"`{state.name.lower()}`", state.text) for state in SafetyState]
    transitions = [
        (
            f"`{row.state.name.lower()}`",
            f"`{row.condition.name.lower()}`: {row.condition.text}",
            f"`{row.then.name.lower()}`",
        )
        for row in TABLE
    ]
    faults = [(f"`{fault.name.lower()}`", fault.text) for fault in Fault]
    return {
        "states": table_markdown(("state", "command of the controller"), states),
        "transitions": table_markdown(("state", "if", "then"), transitions),
        "faults": table_markdown(("fault", "what happens"), faults),
    }


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

For everybody who simulates or diagnoses a real vehicle: which deviations from the nominal model
are known, and how does each show? `tombo list effects` lists them. The simulation can switch them
on, the diagnosis can fit them.
Switch one on in a scenario (`effects: {steady_wind: {east: 2.0}}`) or by
`--set effects.steady_wind.east=2`. A parameter that is not given has its *null*
value; with all of its parameters at null an effect adds exactly nothing. *Typical* is a size
that clearly matters in flight. Between healthy vehicles a parameter differs by a standard
deviation of 5 % of it, unless the effect states another.

The chosen propeller sets `blade_strike`, `propeller_wear` and `thrust_scatter`: its figures of the
paper's Table III, and the scatter of its set. A scenario can replace them.
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
    rows = [
        (f"`{p.name}`", p.unit, f"{p.null:g}", f"{p.bounds[0]:g} to {p.bounds[1]:g}",
         f"{p.typical:g}", p.doc)
        for p in entry.theta
    ]  # fmt: skip
    table = table_markdown(("parameter", "unit", "null", "bounds", "typical", "what"), rows)
    lines = [f"### `{entry.name}`", entry.doc, "", f"{table}\nShows as: {entry.signature}."]
    if not entry.healthy_spread:
        lines.append("Of a healthy vehicle it is exactly as in the nominal model.")
    elif entry.healthy_spread != HEALTHY_SPREAD:
        lines.append(f"Between healthy vehicles: {entry.healthy_spread:.1%} of the typical size.")
    for other, manoeuvre in entry.separates_from.items():
        lines.append(f"Distinguished from `{other}` by: {manoeuvre}.")
    return "\n".join(lines) + "\n"


def claims_markdown(r: Reproduction) -> str:
    """Return the claims of docs/reproduction.md: both counts, then a table for each group."""
    parts = [f"{headline(r)}. {checks_summary(r)}\n"]
    for group in GROUPS:
        rows = [
            [
                cell.replace("|", "\\|")
                for cell in (
                    *(f"{c.claim} ({c.source})", KINDS[c.kind], c.paper, computed_text(c)),
                    *(f"**{verdict_text(c)}**", c.evidence),
                )
            ]
            for c in r.claims
            if c.group == group
        ]
        if rows:
            head = ("claim", "kind", "paper", "computed", "verdict", "evidence")
            parts.append(f"### {group}\n\n{table_markdown(head, rows)}")
    return "\n".join(parts)


SIM = "sim"


def wiring_mermaid(cores: Sequence[type[Core]], sensors: Iterable[str], command: str) -> str:
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
