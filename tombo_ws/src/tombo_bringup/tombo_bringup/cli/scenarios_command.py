"""`tombo scenarios`: what can be flown by name."""

from __future__ import annotations

from tombo_bringup.cli.name_list import print_names
from tombo_bringup.cli.options import JsonOnly


def scenarios(as_json: JsonOnly = False) -> None:
    """List the scenarios that come with the suite."""
    from tombo_flight.scenario_catalogue import builtin_scenarios

    own = "Your own file: tombo fly my_scenario.yaml, with `extends: paper_collision`."
    print_names(builtin_scenarios(), own, as_json)
