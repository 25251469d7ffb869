"""What the workbench computes: functions of requests, without a server."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.propeller import Library
from tombo_propeller.workbench.curves import propeller_curves
from tombo_propeller.workbench.propeller_choice import PropellerChoice, propeller_choice


@dataclass(frozen=True)
class Answer:
    """Content in the types of JSON, or the bytes of a file."""

    content: Any
    file_name: str | None = None


class Workbench:
    """Answers requests about propellers of a library."""

    def __init__(self, library: Library) -> None:
        """Answer with the materials and measurements of a library."""
        self._library = library
        self._flights: dict[int, str] = {}
        self._functions: dict[str, Callable[[Mapping[str, Any]], Answer]] = {
            "curves": self._curves
        }

    def answer(self, what: str, values: Mapping[str, Any]) -> Answer:
        """Return the answer to a request.

        Raises:
            InputError: names the key, the value and what is accepted.
        """
        if what not in self._functions:
            raise unknown_name("request", what, self._functions)
        return self._functions[what](values)

    def flight_page(self, number: int) -> str | None:
        """Return the page of a flight, None if there is none of this number."""
        return self._flights.get(number)

    def _curves(self, values: Mapping[str, Any]) -> Answer:
        choice = self._choice(values)
        curves = propeller_curves(choice, self._library, values.get("top_rpm"))
        return Answer(curves.mapping())

    def _choice(self, values: Mapping[str, Any]) -> PropellerChoice:
        given = values.get("propeller", {})
        if not isinstance(given, Mapping):
            raise InputError(f"propeller: {shown(given)}; accepted: an object")
        return propeller_choice(given, self._library)
