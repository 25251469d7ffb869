"""The dataclasses of `tombo_dynamics/messages.py`, written from the `.msg` files of `tombo_msgs`.

`make messages` writes them, a test says when they are out of date. A line of a definition gives a
field or a constant, its comment the unit and the meaning:

    uint8 RECOVERY_ON=2             # it flies with the gains of the recovery
    std_msgs/Header header          # [s] stamp: time of the setpoint; frame map (ENU)
    geometry_msgs/Point position    # [m] of base_link in map
    uint8 recovery                  # [-] no frame; one of the RECOVERY_ constants

Constants that a field is `one of` become an enum with the name of the field; one that is a `value
of FIELD` becomes a constant of the module. A message with a field that has no fixed number of
values becomes no dataclass: no core takes it.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from tombo_bag.schemas import own_definitions
from tombo_benchmarks.docs.markdown import updated
from tombo_dynamics.errors import InputError

_ENUMS: Final = {
    "PositionSetpoint.recovery": "RecoveryMode",
    "ReactionStatus.state": "ReactionPhase",
}
"""Enums that are not called like their field."""
_LATER: Final = {
    "PositionSetpoint": ("recovery", "takeoff_commands"),
    "CollisionEvent": ("rotor", "push"),
}
"""Fields that the first recordings do not have: where they are missing, they are 0 or unknown."""
_OWN_FRAME: Final = ("CollisionEvent",)
"""Messages whose core refuses another frame itself, so that they carry the frame's name."""
_FRAMES: Final = {"map": "FRAME_MAP", "base_link": "FRAME_BODY"}
_LENGTHS: Final = {
    "geometry_msgs/Point": 3,
    "geometry_msgs/Vector3": 3,
    "geometry_msgs/Quaternion": 4,
}
_WIDTH: Final = 99
_INDENT: Final = 4 * " "

_CONSTANT = re.compile(r"(?P<type>\w+)\s+(?P<name>[A-Z]\w*)\s*=\s*(?P<value>\S+)")
_FIELD = re.compile(r"(?P<type>[\w/]+)(\[(?P<length>[^]]*)\])?\s+(?P<name>[a-z]\w*)(\s+\S+)?")
_ONE_OF = re.compile(r"one of the (constants above|(?P<start>\w+_) constants)")
_HEADER = re.compile(r"stamp: (?P<doc>.+); frame (?P<frame>map|base_link)( \(\w+\))?")


class _Constant(NamedTuple):
    name: str
    value: str
    doc: str


class _Field(NamedTuple):
    """A field of a definition; `length` as it stands in its brackets, None without any."""

    type: str
    length: str | None
    name: str
    unit: str
    doc: str


@dataclass(frozen=True)
class _Definition:
    """A `.msg` file: its name, the text at its top, constants and fields."""

    name: str
    doc: str
    constants: tuple[_Constant, ...]
    fields: tuple[_Field, ...]

    @property
    def is_fixed(self) -> bool:
        """Whether each field has a fixed number of values."""
        return all(one.length is None or one.length.isdecimal() for one in self.fields)


def message_classes(definitions: Mapping[str, str]) -> str:
    """Return the enums and dataclasses of the definitions as source text.

    Args:
        definitions: type name → text of its `.msg` file.

    Raises:
        InputError: a line does not say what is needed.
    """
    read = [_read(typename.rpartition("/")[2], text) for typename, text in definitions.items()]
    fixed = [definition for definition in read if definition.is_fixed]
    parts = [part for definition in fixed for part in _enums(definition)]
    parts += [part for definition in fixed for part in _constants(definition)]
    parts += [_class(definition) for definition in fixed]
    names = "".join(f"{_INDENT}{definition.name},\n" for definition in fixed)
    parts.append(f'MESSAGES: tuple[type[Any], ...] = (\n{names})\n"""Those of `tombo_msgs`."""\n')
    return "\n\n" + "\n\n".join(parts) + "# "


def message_module(module: str) -> str:
    """Return the text of the module with the classes as they are to be.

    Raises:
        InputError: a definition can't be read.
    """
    return updated(module, {"messages": message_classes(own_definitions())})


def main() -> None:
    """Write the classes into the module."""
    path = Path(__file__).parents[3] / "tombo_dynamics" / "tombo_dynamics" / "messages.py"
    path.write_text(message_module(path.read_text(encoding="utf-8")), encoding="utf-8")


def _read(name: str, text: str) -> _Definition:
    lines = text.strip().splitlines()
    top = [line for line in lines[: _top_length(lines)] if line]
    constants, fields = [], []
    for line in lines[len(top) :]:
        content, _, comment = (part.strip() for part in line.partition("#"))
        if constant := _CONSTANT.fullmatch(content):
            constants.append(_Constant(constant["name"], constant["value"], comment))
        elif field := _FIELD.fullmatch(content):
            unit, doc = _unit(name, line, comment)
            fields.append(_Field(**field.groupdict(), unit=unit, doc=doc))
        elif content:
            raise InputError(f"{name}.msg: '{line}'; accepted: a field or a constant")
    doc = " ".join(line.lstrip("# ") for line in top)
    return _Definition(name, doc, tuple(constants), tuple(fields))


def _top_length(lines: list[str]) -> int:
    return next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))


def _unit(name: str, line: str, comment: str) -> tuple[str, str]:
    found = re.fullmatch(r"\[(?P<unit>[^]]+)\] (no frame; )?(?P<doc>.+)", comment)
    if found is None:
        raise InputError(f"{name}.msg: '{line}'; accepted: a comment as '# [m] what it is'")
    return found["unit"].replace("-", "1"), found["doc"]


def _values(definition: _Definition, field: _Field) -> dict[str, _Constant]:
    """Return the constants that a field is one of, by their names without the common start."""
    found = _ONE_OF.search(field.doc)
    start = "" if found is None else found["start"] or ""
    return {
        constant.name.removeprefix(start): constant
        for constant in definition.constants
        if found is not None and constant.name.startswith(start)
    }


def _enums(definition: _Definition) -> Iterator[str]:
    for field in definition.fields:
        values = _values(definition, field)
        if values:
            lines = [
                f"{key} = {one.value}" + (f"  # {one.doc}" if one.doc else "")
                for key, one in values.items()
            ]
            doc = f"Values of `{definition.name}.{field.name}`."
            yield _block(f"class {_enum_name(definition, field)}(IntEnum):", doc, ["", *lines])


def _enum_name(definition: _Definition, field: _Field) -> str:
    place = f"{definition.name}.{field.name}"
    return _ENUMS.get(place, field.name.title().replace("_", ""))


def _constants(definition: _Definition) -> Iterator[str]:
    listed = [one for field in definition.fields for one in _values(definition, field).values()]
    for constant in definition.constants:
        if constant not in listed:
            name = _constant_name(definition, constant)
            place = f"{definition.name}.{constant.name}"
            yield f'{name} = {constant.value}\n"""`{place}`: {constant.doc}."""\n'


def _constant_name(definition: _Definition, constant: _Constant) -> str:
    found = re.match(r"value of (\w+)", constant.doc)
    if found is None:
        raise InputError(
            f"{definition.name}.msg: {constant.name}; accepted: a constant that a field is "
            "'one of', or whose comment begins with 'value of FIELD'"
        )
    field = found[1].upper()
    return constant.name if constant.name.startswith(field) else f"{field}_{constant.name}"


def _class(definition: _Definition) -> str:
    lines: list[str] = []
    for field in definition.fields:
        if field.type == "std_msgs/Header":
            header = _HEADER.fullmatch(field.doc)
            if header is None:
                raise InputError(
                    f"{definition.name}.msg: header '{field.doc}'; accepted: "
                    f"'stamp: what it is; frame {'|'.join(_FRAMES)}'"
                )
            lines += ["", f"frame: ClassVar[str] = {_FRAMES[header['frame']]}"]
            lines += ['stamp_ns: int = field(metadata={"unit": "ns"})', *_doc(header["doc"])]
            if definition.name in _OWN_FRAME:
                lines.append("frame_id: str")
        else:
            doc = _ONE_OF.sub(f"a `{_enum_name(definition, field)}`", field.doc)
            lines += [*_declaration(definition, field), *_doc(doc)]
    return _block(f"@dataclass(frozen=True)\nclass {definition.name}:", definition.doc, lines)


def _declaration(definition: _Definition, field: _Field) -> list[str]:
    length = int(field.length) if field.length else _LENGTHS.get(field.type)
    default = None
    if field.name in _LATER.get(definition.name, ()):
        unknown = [one for one in definition.constants if f"value of {field.name} " in one.doc]
        default = _constant_name(definition, unknown[0]) if unknown else "0"
    if length is not None:
        content = f'metadata={{"unit": "{field.unit}", "length": {length}}}'
        if default is not None:
            content = f"default_factory=lambda: np.zeros({length}), {content}"
        return [f"{field.name}: Array = field({content})"]
    if field.type == "builtin_interfaces/Time":
        return [f'{field.name}_ns: int = field(metadata={{"unit": "ns"}})']
    kind = _kind(definition, field)
    if field.unit == "1":
        return [f"{field.name}: {kind}" + ("" if default is None else f" = {default}")]
    content = f'metadata={{"unit": "{field.unit}"}}'
    if default is not None:
        content = f"default={default}, {content}"
    return [f"{field.name}: {kind} = field({content})"]


def _kind(definition: _Definition, field: _Field) -> str:
    for name, kind in (("u?int", "int"), ("float", "float"), ("bool", "bool"), ("string", "str")):
        if re.fullmatch(rf"{name}\d*", field.type):
            return kind
    raise InputError(
        f"{definition.name}.msg: {field.name} is {field.type}; accepted: numbers, string, Time, "
        f"{', '.join(_LENGTHS)}"
    )


def _block(head: str, doc: str, lines: list[str]) -> str:
    body = "".join(f"{_INDENT}{line}\n" if line else "\n" for line in lines)
    return f"{head}\n{_docstring(doc)}{body}"


def _docstring(doc: str) -> str:
    """Return a docstring: its first sentence, or what fits of it, in a line of its own."""
    first, rest = doc, ""
    for end in (". ", ": ", ", "):
        if end == ". " or len(first) > _WIDTH - len(_INDENT) - len(6 * '"' + "."):
            first, _, rest = doc.partition(end)
    summary = f'{_INDENT}"""{_sentence(first)}'
    if not rest:
        return f'{summary}"""\n'
    lines = textwrap.wrap(_sentence(rest), _WIDTH - len(_INDENT))
    return f"{summary}\n\n" + "".join(f"{_INDENT}{one}\n" for one in [*lines, '"""'])


def _doc(text: str) -> list[str]:
    """Return the docstring of a field, as lines."""
    return textwrap.wrap(f'"""{_sentence(text)}"""', _WIDTH - len(_INDENT))


def _sentence(text: str) -> str:
    if text.split()[0].isalpha():
        text = text[0].upper() + text[1:]
    return text if text.endswith(".") else f"{text}."


if __name__ == "__main__":
    main()
