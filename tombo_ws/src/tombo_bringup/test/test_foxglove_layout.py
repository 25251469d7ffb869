"""foxglove/tombo.json: of the shape that Foxglove imports, and every path leads to a value."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tombo_bag.schemas import type_store
from tombo_bag.topics import TOPICS

SRC = Path(__file__).parents[4] / "tombo_ws/src"
LAYOUT: dict[str, Any] = json.loads((SRC / "tombo_bringup/foxglove/tombo.json").read_text())
PANELS: dict[str, dict[str, Any]] = LAYOUT["configById"]

NUMBERS = {"bool", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64))}
NUMBERS |= {"float32", "float64"}

# The grammar of message paths: topic, then fields, each with a slice and filters.
PART = re.compile(
    r"""\.(?P<name>\w+)(?P<slice>\[(?:\d+|\d*:\d*)\])?(?P<filter>\{\w+==(?:\d+|"[^"]*")\})?"""
)


def kind(panel: str) -> str:
    return panel.partition("!")[0]


# --- Paths ------------------------------------------------------------------------------------


@cache
def fields(typename: str) -> dict[str, Any]:
    return dict(type_store().fielddefs[typename][1])


def element(descriptor: Any) -> tuple[str, bool]:
    """(type name, whether it is a list of them) of a field as rosbags describes it."""
    what, inside = descriptor[0].name, descriptor[1]
    if what in {"ARRAY", "SEQUENCE"}:
        return element(inside[0])[0], True
    return (inside[0] if what == "BASE" else inside), False


def value_type(path: str) -> str:
    """Type of the field at a message path; fails where it leads nowhere."""
    topic = re.match(r"[\w/]+", path)
    assert topic, path
    spec = TOPICS[topic[0]]
    typename, at = spec.typename, topic.end()
    while at < len(path):
        part = PART.match(path, at)
        assert part, f"{path}: not a path from {path[at:]}"
        typename, many = element(fields(typename)[part["name"]])
        assert bool(part["slice"]) == many, (
            f"{path}: {part['name']} is{' not' * (not many)} a list"
        )
        if part["filter"]:
            assert re.match(r"\{(\w+)==", part["filter"])[1] in fields(typename)
        at = part.end()
    return typename


def paths(panel_kind: str) -> list[str]:
    return [
        path["value"]
        for panel, settings in PANELS.items()
        if kind(panel) == panel_kind
        for path in settings["paths"]
    ]


@pytest.mark.parametrize("path", paths("Plot"))
def test_a_plotted_path_leads_to_a_number(path: str):
    if path.startswith("/diagnostics"):
        assert value_type(path) == "string", "Foxglove reads numbers from texts"
    else:
        assert value_type(path) in NUMBERS


@pytest.mark.parametrize("path", paths("StateTransitions"))
def test_a_state_leads_to_a_value(path: str):
    assert value_type(path) in {*NUMBERS, "string"}


@pytest.mark.parametrize(
    "path", [s["topicPath"] for p, s in PANELS.items() if kind(p) == "RawMessages"]
)
def test_a_raw_message_is_of_a_topic(path: str):
    assert value_type(path)
