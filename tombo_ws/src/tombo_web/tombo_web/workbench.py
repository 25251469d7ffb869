"""The workbench's computations: functions of requests, without a server."""

from __future__ import annotations

import io
import threading
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from itertools import count
from typing import Any, Final

from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.propeller import Library
from tombo_flight.json_text import plain
from tombo_flight.report.flight_report import report_page
from tombo_flight.report.page import page_html
from tombo_propeller.design.design import design
from tombo_propeller.design.flight_check import recommend
from tombo_propeller.design.page import candidate_mapping, design_page
from tombo_propeller.design.request import DesignRequest
from tombo_propeller.workbench.curves import propeller_curves
from tombo_propeller.workbench.propeller_choice import ChosenPropeller, propeller_choice
from tombo_propeller.workbench.vehicle_request import (
    STRONGEST_N,
    design_request,
    fly,
    flyable_files,
)
from tombo_web.workbench_page import knobs_of

_PAGES_KEPT: Final = 12
_LONG: Final = ("design", "fly")
"""Requests that are refused while one of them is answered."""
_RANKED: Final = 15
"""Candidates that keep to all limits and are listed, the recommended one first."""


class Workbench:
    """Answers requests about propellers of a library.

    A request is an object with `propeller` and, where a vehicle is needed, `vehicle`.
    """

    def __init__(self, library: Library) -> None:
        """Answer with the materials and measurements of a library."""
        self._library = library
        self._pages: OrderedDict[int, str] = OrderedDict()
        self._numbers = count(1)
        self._long = threading.Lock()
        self._functions: dict[str, Callable[[Mapping[str, Any]], Any]] = {
            "curves": self._curves,
            "design": self._design,
            "fly": self._fly,
            "library": self._files,
        }

    def answer(self, what: str, values: Mapping[str, Any]) -> Any:
        """Return the answer, in the types of JSON, or as the bytes of an archive.

        Raises:
            InputError: a value is refused; the message names key, value and accepted values.
        """
        if what not in self._functions:
            raise unknown_name("request", what, self._functions)
        function = self._functions[what]
        if what not in _LONG:
            return function(values)
        if not self._long.acquire(blocking=False):
            raise InputError("busy with a design or a flight; accepted: when it has ended")
        try:
            return function(values)
        finally:
            self._long.release()

    def page(self, number: int) -> str | None:
        """Return the page of a flight or a design, None if there is none of this number."""
        return self._pages.get(number)

    def _curves(self, values: Mapping[str, Any]) -> Any:
        top_rpm = values.get("top_rpm")
        return propeller_curves(self._choice(values), self._library, top_rpm)

    def _design(self, values: Mapping[str, Any]) -> Any:
        choice, request = self._both(values)
        found = design(request, self._library, choice.blade)
        recommendation = recommend(found, ())
        page = design_page(found, recommendation)
        order = found.choice.order[:_RANKED]
        return {
            "headline": page.data["headline"],
            "why": [*page.data["reasons"], *page.data["must_give"]],
            "candidates": [
                {
                    **plain(candidate_mapping(found, i)),
                    **knobs_of(found.evaluated.configurations[i]),
                }
                for i in order
            ],
            "page": self._keep(page_html(page)),
        }

    def _fly(self, values: Mapping[str, Any]) -> Any:
        choice, request = self._both(values)
        flight = fly(choice, request, self._library, values.get("seed", 0))
        names = ("collided", "crashed", "recovery_time_s", "max_falling_distance_m")
        content = {name: flight.summary[name] for name in names}
        force = flight.scenario["effects"]["blade_strike"]["peak_force"]
        content |= {"force_N": force, "force_capped": force >= STRONGEST_N}
        return {**content, "page": self._keep(page_html(report_page(flight)))}

    def _files(self, values: Mapping[str, Any]) -> Any:
        choice, request = self._both(values)
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in flyable_files(choice, request, self._library).items():
                archive.writestr(f"propeller/{name}", text)
        return buffer.getvalue()

    def _both(self, values: Mapping[str, Any]) -> tuple[ChosenPropeller, DesignRequest]:
        choice = self._choice(values)
        return choice, design_request(_object(values, "vehicle"), choice.blade)

    def _choice(self, values: Mapping[str, Any]) -> ChosenPropeller:
        return propeller_choice(_object(values, "propeller"), self._library)

    def _keep(self, page: str) -> int:
        number = next(self._numbers)
        self._pages[number] = page
        while len(self._pages) > _PAGES_KEPT:
            self._pages.popitem(last=False)
        return number


def _object(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    given = values.get(name, {})
    if not isinstance(given, Mapping):
        raise InputError(f"{name}: {shown(given)}; accepted: an object")
    return given
