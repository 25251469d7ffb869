"""The arena: where its pillars stand, what its figures are, which flights it shows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tombo_flight.arena.page import draw_map
from tombo_flight.arena.results import HEAD, arena_results, table_rows
from tombo_flight.arena.study import (
    ANGLE_RADIUS,
    COLLISIONS,
    CONFIGURATIONS,
    ROW_KEYS,
    SPEED_OFFSET,
    ArenaCase,
    ArenaStudy,
    Match,
    arena_cases,
    touching_pillar,
)
from tombo_flight.process.study import Task
from tombo_flight.scenario import load_scenario

PAPER = load_scenario()


@pytest.mark.parametrize(
    ("name", "angle"),
    [("paper_collision", 0), ("pillar_wide", 0), ("side_hit", 90), ("rear_hit", 180)],
)
def test_a_turned_pillar_is_that_of_the_scenario_with_this_course(name, angle):
    obstacle = load_scenario(name).obstacle
    found = touching_pillar(PAPER, math.radians(angle), obstacle.radius)
    assert found == pytest.approx((obstacle.x, obstacle.y), abs=2e-4)


@pytest.mark.parametrize("angle", [10, 45, 60, 75, 135, 170])
@pytest.mark.parametrize("radius", [0.03, 0.5])
def test_one_disc_touches_the_pillar_where_the_course_has_reached_x_c(angle, radius):
    course = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    pillar = np.array(touching_pillar(PAPER, math.radians(angle), radius))
    hubs = PAPER.vehicle.rotor_positions()[:, :2]
    gaps = np.linalg.norm(hubs + 1.7 * course - pillar, axis=1) - radius - 0.1111
    touching, *others = sorted(gaps)
    assert touching == pytest.approx(0.0, abs=2e-4)
    assert min(others) > 0.03
    earlier = np.linalg.norm(hubs + 1.6 * course - pillar, axis=1) - radius - 0.1111
    assert min(earlier) > 0.05  # nothing is hit on the way


def test_the_cases_are_those_that_are_asked_for():
    cases = arena_cases()
    assert len({case.name for case in cases}) == len(cases)
    within = {group: [c for c in cases if c.group == group] for group in {c.group for c in cases}}
    assert len(within[CONFIGURATIONS]) == 13
    assert {"pole", "side_hit", "1.5 m/s"} <= {case.name for case in within[COLLISIONS]}
    speeds, offsets = zip(*(case.place for case in within[SPEED_OFFSET]), strict=True)
    assert (min(speeds), max(speeds), min(offsets)) == (0.5, 1.5, 0.0)
    angles, radii = zip(*(case.place for case in within[ANGLE_RADIUS]), strict=True)
    assert (min(angles), max(angles), min(radii), max(radii)) == (0, 180, 0.03, 0.5)
    one = next(case for case in within[SPEED_OFFSET] if case.place == (1.25, 0.45))
    scenario = Match("reflex", one, True).scenario()
    assert (scenario.mission.approach_speed, scenario.obstacle.y) == (1.25, 0.45)
    assert (scenario.reaction.name, scenario.disturbances) == ("reflex", True)
    assert list(one.seeds(range(10, 20))) == [10, 11, 12, 13]
    assert Match("reflex", one, True).command(7) == (
        "tombo fly paper_collision --disturbances --reaction reflex --seed 7 "
        "--set mission.approach_speed=1.25 --set obstacle.y=0.45"
    )


def row(seed, fall, **changes):
    known = dict.fromkeys(ROW_KEYS) | {
        "seed": seed, "collided": True, "detected": True, "crashed": False, "landed": True,
        "false_alarms": 0, "contact_rotor": "front_left", "duration_s": 36.0, "strikes": 1,
        "max_falling_distance_m": fall, "recovery_time_s": 2.0,
    }  # fmt: skip
    return known | changes


def made(falls):
    """A study of one case with a flight of each fall, and its rows."""
    case = ArenaCase("paper_collision", COLLISIONS, "paper_collision")
    match = Match("bounce", case, False)
    tasks = tuple(Task(str(seed), match, seed) for seed in range(len(falls)))
    rows = {task.key: row(task.seed, fall) for task, fall in zip(tasks, falls, strict=True)}
    return ArenaStudy(range(len(falls)), (match,), tasks, {}), rows


def test_figures_are_those_of_the_rows_by_hand():
    study, kept = made([0.1, 0.5, 0.2, 0.3])
    kept["1"] |= {"crashed": True, "recovery_time_s": None, "strikes": 5, "struck_rotor": "frame"}
    kept["2"] |= {"false_alarms": 1, "struck_rotor": "front_left", "contact_known_s": 0.003}

    results = arena_results(study, kept)

    (found,) = results["results"]
    assert found["command"] == "tombo fly paper_collision --reaction bounce --seed 0"
    assert (found["flights"], found["crashed"], found["recovered"]) == (4, 1, 3)
    low, high = found["crash_rate_95"]  # ends at which the count is 2.5 % likely
    assert 1.0 - (1.0 - low) ** 4 == pytest.approx(0.025, abs=1e-4)
    assert (1.0 - high) ** 4 + 4.0 * high * (1.0 - high) ** 3 == pytest.approx(0.025, abs=1e-4)
    assert found["max_falling_distance_m"]["median"] == 0.25
    assert found["max_falling_distance_m"]["p05"] == pytest.approx(0.115)  # 0.15 of 0.1 to 0.2
    assert found["strikes"]["mean"] == 2.0
    assert found["contact_known_s"]["p95"] == 0.003
    assert found["false_alarms_per_hour"] == 25.0  # one in 144 s
    assert (found["struck_rotor_named"], found["struck_rotor_right"]) == (2, 0.5)
    assert results["collisions"]["bounce"]["flights"] == 4
    ((case, (cells,)),) = table_rows(results)
    shown = dict(zip(HEAD, cells, strict=True))
    assert case == "paper_collision"
    assert shown["crashed"] == "1 of 4 (0.6 to 80.6 %)"
    assert (shown["strikes"], shown["known, 95 % [ms]"]) == ("2.0", "3")
    assert shown["peak force [N]"] == "–"


@pytest.mark.parametrize("crash", [None, 1])
def test_typical_has_the_median_fall_and_worst_is_a_crash_before_a_deep_fall(crash):
    study, kept = made([0.4, 0.2, 0.1, 0.3, 0.9])
    if crash is not None:
        kept[str(crash)]["crashed"] = True
    typical, worst = arena_results(study, kept)["shown"]
    assert (typical["kind"], typical["seed"]) == ("typical", 3)
    assert (worst["kind"], worst["seed"]) == ("worst", 4 if crash is None else 1)


@pytest.mark.slow
@pytest.mark.parametrize("group", [SPEED_OFFSET, ANGLE_RADIUS])
def test_a_map_shows_the_crash_rate_of_each_cell_at_its_place(group):
    cases = [case for case in arena_cases() if case.group == group]
    matches = tuple(Match("bounce", case, False) for case in cases)
    tasks = tuple(
        Task(f"{match.case.name}/{seed}", match, seed) for match in matches for seed in (0, 1)
    )
    crashes = {cases[1].name: 2, cases[-1].name: 1}
    kept = {
        task.key: row(task.seed, 0.3, crashed=task.seed < crashes.get(task.point.case.name, 0))
        for task in tasks
    }
    results = arena_results(ArenaStudy(range(2), matches, tasks, {}), kept)
    panel = draw_map(results, group, "across", "up").axes[0]
    (image,) = panel.images
    xs, ys = (
        [float(t.get_text()) for t in a.get_ticklabels()] for a in (panel.xaxis, panel.yaxis)
    )
    shown = {(x, y): image.get_array()[ys.index(y), xs.index(x)] for x in xs for y in ys}
    assert shown == {case.place: 50.0 * crashes.get(case.name, 0) for case in cases}
    assert panel.get_title(loc="left") == f"bounce: 3 of {len(tasks)} crashed"
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("across", "up")
