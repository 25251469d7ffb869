"""The dataclasses of the messages have the fields, units and constants of their definitions."""

from __future__ import annotations

import dataclasses
import re
from enum import EnumType

import pytest

from tombo_bag.schemas import own_definitions
from tombo_dynamics import messages

_FIELD = re.compile(
    r"(?P<type>[\w/]+)(\[(?P<length>\d*)\])? +(?P<name>[a-z]\w*) *# \[(?P<unit>.+?)\]"
)
_CONSTANT = re.compile(r"\w+ +(?P<name>[A-Z]\w*) *= *(?P<value>-?\d+)")
_LENGTHS = {"Point": "3", "Vector3": "3", "Quaternion": "4"}
DEFINITIONS = {name.rpartition("/")[2]: text for name, text in own_definitions().items()}
KINDS = {kind.__name__: kind for kind in messages.MESSAGES}


def defined_fields(text):
    """Name, unit and length of each field; the header is its stamp."""
    for found in map(_FIELD.match, text.splitlines()):
        if found:
            kind = found["type"].rpartition("/")[2]
            length = found["length"] or _LENGTHS.get(kind)
            if kind in ("Header", "Time"):
                yield ("stamp_ns" if kind == "Header" else f"{found['name']}_ns", "ns", None)
            else:
                unit = found["unit"].replace("-", "1")
                yield found["name"], unit, length and int(length)


def test_every_message_of_a_fixed_size_has_a_dataclass():
    fixed = {
        name for name, text in DEFINITIONS.items() if not re.search(r"^[\w/]+\[\]", text, re.M)
    }
    assert KINDS.keys() == fixed


@pytest.mark.parametrize("name", KINDS)
def test_fields_have_the_order_the_units_and_the_lengths_of_the_definition(name):
    written = [
        (one.name, one.metadata.get("unit", "1"), one.metadata.get("length"))
        for one in dataclasses.fields(KINDS[name])
        if one.name != "frame_id"
    ]
    assert written == list(defined_fields(DEFINITIONS[name]))


def constants_of(name):
    """The constants of the module, and those of the enums that are values of a field."""
    for constant, value in vars(messages).items():
        if isinstance(value, EnumType) and (value.__doc__ or "").startswith(f"Values of `{name}."):
            yield from ((one.name, int(one)) for one in value)
        elif isinstance(value, int):
            yield constant, value


@pytest.mark.parametrize("name", KINDS)
def test_constants_have_the_values_of_the_definition(name):
    written = list(constants_of(name))
    for found in _CONSTANT.finditer(DEFINITIONS[name]):
        ends = {value for key, value in written if f"_{found['name']}".endswith(f"_{key}")}
        starts = {value for key, value in written if key.endswith(f"_{found['name']}")}
        assert int(found["value"]) in ends | starts, found["name"]
