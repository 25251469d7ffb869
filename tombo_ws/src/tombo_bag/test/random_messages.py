"""Random messages of any type, for property tests, and the same as objects of `rosbags`."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype

from tombo_bag.columnar_cdr import NUMBERS
from tombo_bag.schemas import known_types

TEXTS = st.text(st.characters(blacklist_characters="\0", blacklist_categories=["Cs"]), max_size=9)


def examples(number: int) -> settings:
    """Return the settings of a property test that takes its time."""
    return settings(max_examples=number, deadline=None, suppress_health_check=list(HealthCheck))


def supported(typename: str) -> bool:
    """Tell if a type is made of numbers and strings that the package knows."""
    for _, (kind, content) in known_types()[typename][1]:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, content = content[0]
        if kind == Nodetype.NAME and not supported(content):
            return False
        if kind == Nodetype.BASE and content[0] not in (*NUMBERS, "string"):
            return False
    return True


ALL_TYPES = [name for name in sorted(known_types()) if supported(name)]


def numbers(name: str) -> st.SearchStrategy[Any]:
    dtype = NUMBERS[name]
    if dtype.kind == "b":
        return st.booleans()
    if dtype.kind == "f":
        return st.floats(width=8 * dtype.itemsize, allow_nan=False)
    if name == "byte":
        return st.integers(0, 127)  # rosbags takes a single byte as signed
    info = np.iinfo(dtype)
    return st.integers(int(info.min), int(info.max))


def element(kind: int, content: Any) -> st.SearchStrategy[Any]:
    if kind == Nodetype.NAME:
        return messages(content)
    name, bound = content
    if name == "string":
        return TEXTS.map(lambda text: text[: bound or None])
    return numbers(name)


def messages(typename: str) -> st.SearchStrategy[dict[str, Any]]:
    fields = {}
    for name, (kind, content) in known_types()[typename][1]:
        if kind == Nodetype.ARRAY:
            inner, size = content
            fields[name] = st.lists(element(*inner), min_size=size, max_size=size)
        elif kind == Nodetype.SEQUENCE:
            inner, bound = content
            fields[name] = st.lists(element(*inner), max_size=min(bound or 3, 3))
        else:
            fields[name] = element(kind, content)
    return st.fixed_dictionaries(fields)
