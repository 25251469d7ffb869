"""A study of a user's own: the flight of each point, and its kept data."""

from __future__ import annotations

import os

import pytest

from tombo_flight.process.study import Task, fly_seeds, fly_tasks
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow


class Heights:
    """Points are heights of the mission; the kept data names its process."""

    summary_only = False

    def scenario_at(self, point):
        return load_scenario("hover", [f"mission.height={point}", "duration=0.2"])

    def figures(self, flight):
        height = flight.scenario["mission"]["height"]
        figures = {"height": height, "seed": flight.summary["seed"]}
        return {**figures, "process": os.getpid()}


def test_each_task_is_flown_in_another_process_and_kept_under_its_key():
    rows = {}
    heights = (1.0, 2.0, -1.0)  # no vehicle flies below the ground
    tasks = [Task((h, seed), h, seed) for seed in (3, 4) for h in heights]
    fly_tasks(
        Heights(), tasks, len(tasks), lambda flown: rows.update({t.key: row for t, row in flown})
    )
    assert set(rows) == {task.key for task in tasks}
    for (height, seed), row in rows.items():
        if height < 0.0:
            assert "mission.height" in row["error"]
        else:
            assert (row["height"], row["seed"]) == (height, seed)
            assert row["process"] != os.getpid()


def seed_of(flight):
    return {"seed": flight.summary["seed"]}


def test_rows_of_seeds_are_in_the_order_of_the_seeds():
    scenario = load_scenario("hover", ["duration=0.2"])
    rows = fly_seeds(scenario, [5, 2, 9], seed_of)
    assert list(rows.items()) == [(seed, {"seed": seed}) for seed in (5, 2, 9)]
