"""Parameters of a replay: those of the recorded flight, and changes to them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_dynamics.errors import InputError
from tombo_flight.scenario import Scenario, scenario_from_mapping, scenario_over

_SECTIONS = (
    "vehicle", "control", "estimator", "mission", "detector", "react", "reaction", "propeller"
)  # fmt: skip
"""`react`: recordings of older versions have it."""


def scenario_of_bag(
    metadata: Mapping[str, Mapping[str, str]],
    name: str | None = None,
    settings: Sequence[str] = (),
) -> tuple[Scenario, list[str]]:
    """Return the scenario to replay with, and a line on where it comes from.

    Args:
        metadata: of the recording.
        name: a scenario, name or path, over that of the recording.
        settings: `key=value` over both.

    Raises:
        InputError: `name` or `settings` are bad.
    """
    base, label, findings = _recorded(metadata)
    return scenario_over(base, label, name, settings), findings


def _recorded(metadata: Mapping[str, Mapping[str, str]]) -> tuple[dict[str, Any], str, list[str]]:
    text = metadata.get(FLIGHT_METADATA, {}).get("scenario")
    if text is None:
        return {}, "recording", ["no parameters in the bag: the suite's defaults are used"]
    try:
        flown = json.loads(text)
        base = {key: flown[key] for key in _SECTIONS if key in flown}
        label = str(flown.get("name", "recording"))
        scenario_from_mapping(base, label)
    except (
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
    ) as error:  # ValueError: also InputError
        why = str(error) if isinstance(error, InputError) else "no scenario"
        return {}, "recording", [f"parameters in the bag can't be used ({why}): defaults instead"]
    return base, label, []
