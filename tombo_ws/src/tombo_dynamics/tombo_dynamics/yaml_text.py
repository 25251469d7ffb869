"""YAML as the suite reads it: bounded, numbers as in YAML 1.2, errors with their line."""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from tombo_dynamics.errors import InputError, shown

LARGEST = 4_000_000
"""Bytes of a file; those of the suite have a few thousand."""
_DEEPEST = 40
"""Lists and mappings within each other: the loader in C has no limit of its own."""
_MOST_VALUES = 200_000
"""Values; an alias counts with all values that it repeats."""
_LONGEST_NUMBER = 64
"""Characters: any such number is within the range of a float."""
_C_OR_PYTHON: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C one is ten times faster
_C_OR_PYTHON_TEXT: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
_TAG = "tag:yaml.org,2002:"


class _Loader(_C_OR_PYTHON):  # type: ignore[misc]
    """Reads 6e-05 as a number, as YAML 1.2 does; PyYAML alone takes it for text."""


_Loader.add_implicit_resolver(
    f"{_TAG}float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)$"),
    list("-+.0123456789"),
)


def read_yaml(path: Path, what: str, accepted: str = "YAML") -> Any:
    """Return the content of a YAML file.

    Raises:
        InputError: it can't be read or is not YAML; `what` names it.
    """
    return parse_yaml(read_text(path, what, accepted), what)


def read_text(path: Path, what: str, accepted: str = "YAML", largest: int = LARGEST) -> str:
    """Return the text of a file.

    Raises:
        InputError: it can't be read, is not text or too large; `what` names it.
    """
    try:
        with path.open("rb") as file:
            raw = file.read(largest + 1)
        if len(raw) > largest:
            raise InputError(f"{what}: too large; accepted: {accepted}, up to {largest} bytes")
        return raw.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise InputError(
            f"{what} can't be read: {error.strerror}; accepted: {accepted}"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(f"{what} is not text (UTF-8); accepted: {accepted}") from error


def parse_yaml(text: str, what: str, *, as_text: bool = False) -> Any:
    """Return the value of a YAML document.

    Args:
        text: the document.
        what: names it in an error.
        as_text: leave numbers as they are written.

    Raises:
        InputError: it is none, names a key twice, holds itself, or is larger, deeper or longer
            than any file of the suite.
    """
    if len(text) > LARGEST:
        raise InputError(f"{what}: too large; accepted: YAML of up to {LARGEST} bytes")
    try:
        _check_size(text)
        loader = (_C_OR_PYTHON_TEXT if as_text else _Loader)(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _check_nodes(node)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        why, line = _reason(error)
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
        why, line = f"a value that does not fit its tag: {error}", ""  # as `!!int ""`
    raise InputError(f"{what} is not valid YAML{line}: {' '.join(why[:200].split())}")


def _reason(error: Any) -> tuple[str, str]:
    """Return the problem and its line."""
    mark = getattr(error, "problem_mark", None)
    why = getattr(error, "problem", None) or str(error).partition("\n")[0]
    context = getattr(error, "context", None)
    why = f"{why}, {context}" if context else why
    return why, f" at line {mark.line + 1}" if mark is not None else ""


def _check_size(text: str) -> None:
    """Check depth and number of values, aliases expanded, before anything is built.

    Raises:
        yaml.YAMLError: beyond a bound, an alias that contains itself, or invalid YAML.
    """
    values = 0
    extent: dict[str | None, int] = {}
    open_anchors: list[tuple[str | None, int]] = []
    event: Any
    for event in yaml.parse(text, Loader=_C_OR_PYTHON):
        why = ""
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_anchors.pop()
            extent[anchor] = values - before
        elif isinstance(event, yaml.AliasEvent):
            if any(anchor == event.anchor for anchor, _ in open_anchors):
                why = f"*{event.anchor} stands within itself"
            values += extent.get(event.anchor, 1)
        elif isinstance(event, yaml.NodeEvent):
            extent[event.anchor] = 1
            values += 1
            if isinstance(event, yaml.CollectionStartEvent):
                open_anchors.append((event.anchor, values - 1))
        if len(open_anchors) > _DEEPEST:
            why = f"nested more than {_DEEPEST} deep"
        if values > _MOST_VALUES:
            why = f"more than {_MOST_VALUES} values"
        if why:
            raise yaml.MarkedYAMLError(problem=why, problem_mark=event.start_mark)


def _check_nodes(root: Any) -> None:
    """Refuse keys that occur twice in a mapping, and numbers beyond a float.

    Raises:
        yaml.MarkedYAMLError: a key occurs twice, or a number is too long.
    """
    left, seen = [root], set()
    while left:
        node = left.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            left += node.value
        elif node.tag in (f"{_TAG}int", f"{_TAG}float") and len(node.value) > _LONGEST_NUMBER:
            why = f"a number of {len(node.value)} characters"
            raise yaml.MarkedYAMLError(problem=why, problem_mark=node.start_mark)
        elif isinstance(node, yaml.MappingNode):
            left += [part for pair in node.value for part in pair]
            keys: set[Hashable] = set()
            for key, _ in node.value:
                if not isinstance(key, yaml.ScalarNode) or key.tag == f"{_TAG}merge":
                    continue
                if (key.tag, key.value) in keys:
                    why = f"key {shown(key.value)} twice"
                    raise yaml.MarkedYAMLError(problem=why, problem_mark=key.start_mark)
                keys.add((key.tag, key.value))
