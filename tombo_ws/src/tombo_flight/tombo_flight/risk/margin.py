"""How far a flight was from a crash: one number, negative after a crash."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from tombo_dynamics.vehicle import GRAVITY
from tombo_flight.scenario import Scenario

_LEAST = 1e-6
"""Of a flight without a crash: the boundary itself belongs to the crashes."""


def margin(summary: Mapping[str, Any], scenario: Scenario) -> float:
    """Return the margin to a crash, from -1 to 1; below 0 exactly where the flight crashed.

    Without a crash: the smaller of the height that was left above the ground, as a share of that
    at contact, and of the angle that was left to upside down, as a share of pi. After one: minus
    the time of a free fall from that height over the time from contact (from the start without
    one) to the crash, so that it goes to 0 as the crash comes later.

    Args:
        summary: of the flight (docs/figures.md); no log is needed.
        scenario: what was flown.
    """
    legs = scenario.vehicle.leg_height
    contact = summary["contact_position_m"]
    begun = scenario.mission.height if contact is None else float(contact[2])
    height = max(begun - legs, _LEAST)
    if summary["crashed"]:
        lasted = float(summary["crash_time_s"] - (summary["collision_time_s"] or 0.0))
        if lasted <= 0.0:  # it was down, or turned over, before it touched the obstacle
            lasted = float(summary["crash_time_s"])
        return -min(math.sqrt(2.0 * height / GRAVITY) / max(lasted, _LEAST), 1.0)
    left = [1.0]
    if summary["max_tilt_rad"] is not None:
        left.append(1.0 - summary["max_tilt_rad"] / math.pi)
    if summary["max_falling_distance_m"] is not None:
        left.append(1.0 - summary["max_falling_distance_m"] / height)
    return max(min(left), _LEAST)
