"""Files that the suite writes and reads in YAML: whole or not at all, and what their parts are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_flight.json_text import plain
from tombo_flight.process.output_folder import write_whole


def write_yaml(path: Path, text: str, what: str) -> None:
    """Write a text file, whole or not at all.

    Raises:
        InputError: it can't be written; `what` names it.
    """
    try:
        write_whole(path, text)
    except OSError as error:
        raise InputError(f"{what} can't be written: {error.strerror}") from error


def yaml_of(values: Any) -> str:
    """Return plain values as YAML: short mappings in one line, every text as it is read back."""
    return yaml.dump(
        plain(values),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=99,
    )


class _Dumper(yaml.SafeDumper):
    """Writes repeated values without anchors, and every character so that it is read back."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if text.isprintable() else '"'  # plain and single quotes lose odd line breaks
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def mapping_of(value: Any, where: str) -> Mapping[str, Any]:
    """Return a value that must be a mapping.

    Raises:
        InputError: it is none.
    """
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: {shown(value)}; accepted: a mapping of keys to values")
    return value


def list_of(value: Any, where: str) -> list[Any]:
    """Return a value that must be a list; None is an empty one.

    Raises:
        InputError: it is none.
    """
    if value is None:
        return []
    if not isinstance(value, list):
        raise InputError(f"{where}: {shown(value)}; accepted: a list")
    return value


def check_keys(values: Mapping[str, Any], accepted: Iterable[str], where: str) -> None:
    """Refuse a key that is not among those accepted.

    Raises:
        InputError: names the key and similar keys.
    """
    names = list(accepted)
    for key in values:
        if key not in names:
            raise unknown_name(f"key in {where}", str(key), names)
