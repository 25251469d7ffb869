"""The text of summaries: strict JSON, the same bytes for the same values."""

from __future__ import annotations

import json
import math

import numpy as np

from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import WALL_KEYS, flight_summary
from tombo_flight.json_text import as_json
from tombo_flight.scenario import load_scenario


def test_what_json_cannot_say_becomes_null():
    values = {
        "a": math.nan, "b": [1.0, -math.inf, {"c": np.float64("nan")}], "d": np.arange(2),
        "e": np.float32(0.5), "f": np.bool_(True), "g": (1, None), 3: "x", "h": np.int64(7),
    }  # fmt: skip

    found = json.loads(as_json(values), parse_constant=lambda name: 1 / 0)

    assert found == {
        "a": None, "b": [1.0, None, {"c": None}], "d": [0, 1], "e": 0.5, "f": True,
        "g": [1, None], "3": "x", "h": 7,
    }  # fmt: skip


def test_wall_times_are_the_last_keys_and_the_only_ones_that_differ():
    scenario = load_scenario("hover", ["duration=1"])
    first, second = (flight_summary(fly_scenario(scenario, 2)) for _ in range(2))

    assert list(first)[-2:] == list(WALL_KEYS)
    assert list(first) == list(second)
    assert {key for key in first if first[key] != second[key]} <= set(WALL_KEYS)
    assert first["wall_time_s"] > 0.0


def test_a_flight_that_ends_before_its_first_sample_has_a_summary_too():
    record = fly_scenario(load_scenario("hover", ["duration=5"]), 0, stop=lambda: True)

    summary = flight_summary(record, interrupted=True)

    assert summary["interrupted"]
    assert json.loads(as_json(summary)) == summary
    assert 0.0 <= summary["duration_s"] < 2.5
