"""Definitions of message types: fields, schema text and type hash, without an installed ROS.

The standard types are those of ROS 2 Jazzy, as the `rosbags` library carries them; the types of
`tombo_msgs` are read from its `.msg` files, and any other from the `.msg` files of its package
where that is installed. A *type name* is always the long form, `geometry_msgs/msg/PoseStamped`.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from rosbags.interfaces import Nodetype

from tombo_dynamics.errors import InputError, shown, unknown_name

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

Types: TypeAlias = "dict[str, tuple[list[Any], list[tuple[str, Any]]]]"
"""Type name → (constants, fields), each field a name with its descriptor, as `rosbags` has it."""

OWN_PACKAGE = "tombo_msgs"


def message_directory() -> Path:
    """Find the folder of the `tombo_msgs` definitions: the installed one, else the source tree's.

    Raises:
        InputError: no such folder; the message lists where it was looked for.
    """
    source = Path(__file__).resolve().parents[2] / OWN_PACKAGE / "msg"
    folders = [*_installed(OWN_PACKAGE), source]
    for folder in folders:
        if folder.is_dir() and any(folder.glob("*.msg")):
            return folder
    places = ", ".join(map(str, folders))
    raise InputError(f"message definitions of {OWN_PACKAGE} not found; looked in: {places}")


def _installed(package: str) -> Iterator[Path]:
    """List where a package's definitions are if it is installed."""
    for prefix in (*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix):
        if prefix:
            yield Path(prefix) / "share" / package / "msg"


@cache
def own_definitions() -> dict[str, str]:
    """Read the `.msg` files of `tombo_msgs`: type name → text of the file."""
    return {
        f"{OWN_PACKAGE}/msg/{file.stem}": file.read_text(encoding="utf-8")
        for file in sorted(message_directory().glob("*.msg"))
    }


@cache
def type_store() -> Typestore:
    """Return the Jazzy type store with `tombo_msgs` added. Loading takes some 60 ms, once."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    added: Types = {}
    for name, text in own_definitions().items():
        added.update(get_types_from_msg(text, name))
    store.register(added)
    return store


def known_types() -> Types:
    """Return every type this package can write without being given its definition."""
    return type_store().fielddefs


def load_installed_type(typename: str) -> None:
    """Make a type known, with all it depends on, from the packages that are installed.

    Raises:
        InputError: the type, or one it depends on, is neither known nor installed.
    """
    added: Types = {}
    queue = [typename]
    while queue:
        name = queue.pop()
        if name in known_types() or name in added:
            continue
        text = _installed_definition(name)
        if text is None:
            part = "" if name == typename else f" in {typename}"
            raise unknown_name(f"message type{part}", name, known_types())
        added.update(parse_schema(name, text))
        used = (named_type(descriptor) for _, descriptor in added[name][1])
        queue += [name for name in used if name is not None]
    if added:
        type_store().register(added)


def _installed_definition(typename: str) -> str | None:
    package, _, short = typename.partition("/msg/")
    if re.fullmatch(r"\w+", package) and re.fullmatch(r"\w+", short):
        for folder in _installed(package):
            file = folder / f"{short}.msg"
            if file.is_file():
                return file.read_text(encoding="utf-8")
    return None


def schema_text(typename: str) -> str:
    """Return a type's definition in `ros2msg` form, followed by all the types it depends on.

    Raises:
        InputError: the type is not known.
    """
    load_installed_type(typename)
    return type_store().generate_msgdef(typename, ros_version=2)[0]


def named_type(descriptor: Any) -> str | None:
    """Return the message type in a field's descriptor; None for numbers and strings."""
    kind, content = descriptor
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        kind, content = content[0]
    return str(content) if kind == Nodetype.NAME else None


def type_hash(typename: str) -> str:
    """Return the type's `RIHS01_...` hash, by which ROS 2 tells versions of a type apart."""
    load_installed_type(typename)
    return type_store().hash_rihs01(typename)


@cache
def parse_schema(typename: str, text: str) -> Types:
    """Read the `ros2msg` schema of a file: the type and all it depends on.

    Raises:
        InputError: the text is not a message definition.
    """
    from rosbags.typesys import get_types_from_msg

    try:
        return get_types_from_msg(text, typename)
    except Exception as error:  # on other texts rosbags fails in many ways
        raise _not_readable(typename, error) from error


@cache
def ros1_store(typename: str, text: str) -> Typestore:
    """Return the types of ROS 2 Jazzy, with one of ROS 1 that they lack, as its definition says.

    Types that ROS 2 Jazzy knows are as there: a ROS 1 header has lost its count.

    Raises:
        InputError: the text is not a message definition.
    """
    from rosbags.typesys import Stores, get_typestore

    if typename in known_types() or not text:
        return type_store()
    store = get_typestore(Stores.ROS2_JAZZY)
    lacking = {n: of for n, of in parse_schema(typename, text).items() if n not in store.types}
    try:
        store.register(lacking)
    except Exception as error:  # on other texts rosbags fails in many ways
        raise _not_readable(typename, error) from error
    return store


def ros1_as_cdr(store: Typestore, typename: str, data: bytes) -> bytes | None:
    """Return a message of ROS 1 as ROS 2 writes it; None if the bytes are no such message."""
    try:
        return bytes(store.ros1_to_cdr(data, typename))
    except Exception:  # generated code fails in many ways on bytes that don't fit
        return None


def _not_readable(typename: str, error: Exception) -> InputError:
    # the library's error: "Could not parse:", the whole text, a position, the rest of the text
    lines = str(error).splitlines()
    rest = (lines[3] if len(lines) > 3 else str(error)).strip()[:60]
    return InputError(
        f"definition of message type {shown(typename)} can't be read from {rest!r}; "
        "accepted: a ROS message definition"
    )
