"""ROS parameters from parameter records: declared, typed, bounded, described; checked as a whole.

The record is the only truth: `declare` reads type, bounds, unit and meaning from its fields, and a
change is tried on the record first. `ros2 param set` refuses it with the record's reason, or if it
can't be applied while the node runs.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.params import as_text, check_number, from_mapping
from tombo_dynamics.yaml_text import parse_yaml

_KINDS = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    list: Parameter.Type.STRING_ARRAY,
}


_SIM_TIME = "use_sim_time"
_READ_ONLY = "read-only: it is used at the start of the node; restart it with another value"


def describe(field: dataclasses.Field[Any], default: Any) -> ParameterDescriptor:
    """Return the descriptor of a record's field: meaning, unit, source, bounds."""
    meta = field.metadata
    unit = f" [{meta['unit']}]" if "unit" in meta else ""
    descriptor = ParameterDescriptor(
        description=f"{meta.get('doc', field.name)}{unit}",
        additional_constraints=str(meta.get("source", "")),
    )
    if "bounds" in meta:
        set_range(descriptor, default, meta["bounds"])
    return descriptor


def set_range(
    descriptor: ParameterDescriptor, default: float, bounds: tuple[float, float]
) -> None:
    """Enter bounds into a descriptor."""
    low, high = bounds
    if isinstance(default, int) and not isinstance(default, bool):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    else:
        reach = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [reach]


class RecordParameters:
    """The parameters of one node, by section."""

    def __init__(
        self, node: Node, records: Mapping[str, Any], fixed: Collection[str] = ()
    ) -> None:
        """Declare the parameters of records.

        Args:
            node: whose they are.
            records: section -> record with the defaults.
            fixed: sections that are used at the start only. The check is our own: rclpy's, by
                `read_only` of the descriptor, comes before it and gives no reason.

        Raises:
            InputError: a value given at the start is refused.
        """
        self._node = node
        self._fixed = frozenset(fixed)
        self.records: dict[str, Any] = dict(records)
        """Section -> the record as it stands."""
        self._plain: dict[str, Any] = {}
        self._overrides: Mapping[str, Any] = getattr(node, "_parameter_overrides", {})
        for section, record in records.items():
            defaults = _as_parameters(record)
            values = {
                name: self._initial_value(f"{section}.{name}", default)
                for name, default in defaults.items()
            }
            self.records[section] = _checked(record, values, section)
            for field in dataclasses.fields(record):
                descriptor = describe(field, defaults[field.name])
                if section in self._fixed:
                    source = descriptor.additional_constraints
                    descriptor.additional_constraints = f"{source}; {_READ_ONLY}".lstrip("; ")
                self._declare(f"{section}.{field.name}", values[field.name], descriptor)
        self._changed: deque[str] = deque()  # filled by the services' thread, emptied by the loop
        node.add_on_set_parameters_callback(self._on_set)

    def declare(
        self,
        name: str,
        default: Any,
        doc: str,
        *,
        bounds: tuple[float, float] | None = None,
        read_only: bool = True,
    ) -> Any:
        """Declare a parameter of the node's own and return its value.

        Args:
            name: of the parameter.
            default: bool, int, float, str or list of str; its type is the parameter's.
            doc: its meaning, with the unit.
            bounds: of a number, both included.
            read_only: it can be set at the start only.

        Raises:
            InputError: the value given at the start is of another type, or out of bounds.
        """
        descriptor = ParameterDescriptor(description=doc, read_only=read_only)
        value = self._initial_value(name, default)
        if bounds is not None:
            set_range(descriptor, default, bounds)
            check_number(name, value, "1", bounds)
        self._declare(name, value, descriptor)
        if isinstance(value, list):
            value = [text for text in value if text]
        self._plain[name] = value
        return value

    def get(self, name: str) -> Any:
        """Return a parameter declared with `declare`, as it stands."""
        return self._plain[name]

    def changed(self) -> list[str]:
        """Return the sections and names that were set since the last call."""
        return [self._changed.popleft() for _ in range(len(self._changed))]

    def unknown(self) -> list[str]:
        """Return a line for each value given at the start with a name close to a parameter's.

        Names that are like none are meant for other nodes: a file may speak to all of them.
        """
        declared = [*self._plain]
        for section, record in self.records.items():
            declared += [f"{section}.{field.name}" for field in dataclasses.fields(record)]
        lines = []
        for name in self._overrides:
            if name in declared or self._node.has_parameter(name) or name.startswith("qos_"):
                continue
            near = get_close_matches(name, declared, 1, 0.85)
            if near and name.rpartition(".")[0] == near[0].rpartition(".")[0]:
                lines.append(f"unknown parameter '{name}'; did you mean '{near[0]}'?")
        return lines

    def _initial_value(self, name: str, default: Any) -> Any:
        """Return the value given at the start, else the default; raise InputError for its type."""
        override = self._overrides.get(name)
        value = default if override is None or override.value is None else override.value
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)  # YAML's 1 where 1.0 is meant
        if isinstance(value, tuple):
            value = list(value)
        if type(value) is not type(default):
            kind = _KINDS[type(default)].name.lower().replace("_", " ")
            raise InputError(f"parameter {name}: {shown(value)} is no {kind}; accepted: {kind}")
        return value

    def _declare(self, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
        descriptor.type = _KINDS[type(value)].value
        if value == []:
            value = [""]  # an empty array has no type in ROS
        self._node.declare_parameter(name, value, descriptor, ignore_override=True)

    def _on_set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Try all new values on copies of the records; take all of them or none."""
        changes: dict[str, dict[str, Any]] = {}
        plain: dict[str, Any] = {}
        try:
            for parameter in parameters:
                section, _, field = parameter.name.partition(".")
                self._check_not_fixed(parameter, section)
                if section in self.records and field:
                    changes.setdefault(section, {})[field] = parameter.value
                elif parameter.name in self._plain:
                    plain[parameter.name] = parameter.value
            records = {
                section: _checked(self.records[section], values, section)
                for section, values in changes.items()
            }
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.records.update(records)
        self._plain.update(plain)
        self._changed.extend([*records, *plain])
        return SetParametersResult(successful=True)

    def _check_not_fixed(self, parameter: Parameter, section: str) -> None:
        """Refuse a change that would not be applied; the same value once more changes nothing."""
        if section not in self._fixed and parameter.name != _SIM_TIME:
            return
        if parameter.value != self._node.get_parameter(parameter.name).value:
            raise InputError(f"{parameter.name} is {_READ_ONLY}")


def _as_parameters(record: Any) -> dict[str, Any]:
    """Return the record's values as ROS has them: a structure is YAML in a text."""
    values = dataclasses.asdict(record)
    for field in dataclasses.fields(record):
        if "read" in field.metadata:
            values[field.name] = as_text(values[field.name])
    return values


def _checked(record: Any, values: Mapping[str, Any], section: str) -> Any:
    """Return the record with some values changed, all of it checked."""
    read = {f.name for f in dataclasses.fields(record) if "read" in f.metadata}
    values = {
        key: parse_yaml(value, f"{section}.{key}") if key in read and value else value
        for key, value in values.items()
    }
    merged = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    return from_mapping(type(record), {**merged, **values}, section)
