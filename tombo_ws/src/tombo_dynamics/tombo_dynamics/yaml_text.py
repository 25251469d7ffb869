"""YAML as the suite reads it: numbers as in YAML 1.2, an error that says what and where."""

from __future__ import annotations

import re
from typing import Any

import yaml

from tombo_dynamics.errors import InputError


class _Loader(yaml.SafeLoader):
    """Reads 6e-05 as a number, as YAML 1.2 does; PyYAML alone takes it for text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)$"),
    list("-+.0123456789"),
)


def parse_yaml(text: str, what: str) -> Any:
    """Return what YAML says.

    Raises:
        InputError: it is none; `what` names it.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: no such date
        raise InputError(f"{what} is not valid YAML: {' '.join(str(error).split())}") from error
