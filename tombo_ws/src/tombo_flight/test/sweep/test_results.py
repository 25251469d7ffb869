"""Results of a sweep: by hand, from rows that nobody has flown."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tombo_flight.process.study import Task
from tombo_flight.report.page import Table
from tombo_flight.sweep.design import SweepDesign, parse_axis
from tombo_flight.sweep.folder import fly_sweep, open_sweep
from tombo_flight.sweep.page import draw_distributions, sweep_page
from tombo_flight.sweep.results import HEAD, SweepFlights, point_rows
from tombo_flight.sweep.statistics import SPREAD_METRICS
from tombo_flight.sweep.study import figure_columns, new_sweep


def row(**changes):
    """Return the figures of a flight that has touched the pillar and recovered."""
    figures = dict.fromkeys(figure_columns()) | {
        "collided": True, "detected": True, "crashed": False, "landed": True, "false_alarms": 0,
        "contact_rotor": "front_left", "duration_s": 36.0, "strikes": 1, "recovery_time_s": 2.0,
        "max_falling_distance_m": 0.3,
    }  # fmt: skip
    return figures | changes


def opened_with(stack, folder, rows, axes=(), seeds=None, scenario="paper_collision", **design):
    """Return the folder of a sweep with these rows, in the order of its flights."""
    points = SweepDesign(tuple(parse_axis(text) for text in axes), **design)
    study = new_sweep(scenario, points, range(seeds or len(rows)))
    opened = stack.enter_context(open_sweep(folder, study))
    opened.keep([(Task(n, *study.place(n)), figures) for n, figures in enumerate(rows)])
    opened.finish()
    return opened


@pytest.fixture
def results_of(tmp_path):
    from contextlib import ExitStack

    with ExitStack() as stack:

        def results(rows, *arguments, **more):
            return SweepFlights(opened_with(stack, tmp_path / "s", rows, *arguments, **more))

        yield results


def test_figures_are_those_of_the_rows_by_hand(results_of):
    rows = [row(max_falling_distance_m=fall) for fall in (0.1, 0.5, 0.2, 0.3)]
    rows[1] |= {"crashed": True, "recovery_time_s": None, "strikes": 5, "struck_rotor": "frame"}
    rows[2] |= {"false_alarms": 1, "struck_rotor": "front_left", "contact_known_s": 0.003}

    results = results_of([*rows, {"error": "no"}], ("reaction.name=bounce",)).results()

    (found,) = results["points"]
    assert found["command"].startswith("tombo fly paper_collision --seed 0 --set reaction.name=b")
    assert (found["flights"], found["crashed"], found["recovered"]) == (4, 1, 3)
    assert found["max_falling_distance_m"]["median"] == 0.25
    assert found["max_falling_distance_m"]["p05"] == pytest.approx(0.115)  # 0.15 of 0.1 to 0.2
    assert found["strikes"]["mean"] == 2.0
    assert found["contact_known_s"]["p95"] == 0.003
    assert found["false_alarms_per_hour"] == 25.0  # one in 144 s
    assert (found["struck_rotor_named"], found["struck_rotor_right"]) == (2, 0.5)
    assert results["not_flown"] == {"flights": 1, "first": 4, "why": "no"}
    assert results["outcome"] == "1 of 5 crashed, 1 not flown"
    ((group, ((name, *cells),)),) = point_rows(results)
    shown = dict(zip(HEAD, cells, strict=True))
    assert (group, name) == ("all", "bounce")
    assert shown["crashed"] == "1 of 4 (0.6 to 80.6 %)"
    assert (shown["strikes"], shown["known, 95 % [ms]"]) == ("2.0", "3")
    assert shown["peak force [N]"] == "–"


def test_reactions_are_compared_below_each_of_what_else_was_varied(results_of):
    axes = ("reaction.name=bounce,reflex", "mission.approach_speed=0.5,0.7")
    crashes = (1, 1, 0, 0, 0, 1, 0, 0)
    found = results_of([row(crashed=bool(c)) for c in crashes], axes, 2).results()
    table = {
        group: {name: cells[0].split(" (")[0] for name, *cells in rows}
        for group, rows in point_rows(found)
    }
    assert table == {
        "mission.approach_speed = 0.5": {"bounce": "2 of 2", "reflex": "1 of 2"},
        "mission.approach_speed = 0.7": {"bounce": "0 of 2", "reflex": "0 of 2"},
    }
    rates = {(r["key"], r["value"]): (r["crashed"], r["flights"]) for r in found["settings"]}
    assert rates == {
        ("reaction.name", "bounce"): (2, 4), ("reaction.name", "reflex"): (1, 4),
        ("mission.approach_speed", "0.5"): (3, 4), ("mission.approach_speed", "0.7"): (0, 4),
    }  # fmt: skip


def test_the_setting_that_decides_comes_first(results_of):
    axes = ("mission.approach_speed=0.5:1.5", "vehicle.mass=norm(1.3,0.02)")
    count, rng = 400, np.random.default_rng(1)
    design = SweepDesign(tuple(parse_axis(text) for text in axes), "lhs", count)
    speed = np.array([float(design.settings(n)[design.axes[0].key]) for n in range(count)])
    rows = [
        row(crashed=bool(v > 1.2), max_falling_distance_m=float(v + 0.1 * rng.normal()))
        for v in speed
    ]
    flights = results_of(rows, axes, 1, kind="lhs", samples=count)
    found = flights.results()
    (first, second, *rest) = found["decides"]
    assert first["key"] == second["key"] == "mission.approach_speed"
    assert {first["figure"], second["figure"]} == {"crashed", "max_falling_distance_m"}
    assert min(first["rho"], second["rho"]) > 0.7 and max(first["p"], second["p"]) < 1e-9
    assert all(abs(other["rho"]) < 0.2 for other in rest)
    cells = [r for r in found["settings"] if r["key"] == "mission.approach_speed"]
    assert sum(r["flights"] for r in cells) == count
    assert (cells[0]["crash_rate"], cells[-1]["crash_rate"]) == (0.0, 1.0)
    of_mass = [r["flights"] for r in found["settings"] if r["key"] == "vehicle.mass"]
    assert max(of_mass) - min(of_mass) <= 2  # bins of equal probability
    assert found["points"] == []


def test_flights_without_a_collision_have_no_worst_one_and_are_drawn(results_of):
    none = row(collided=False, **dict.fromkeys(SPREAD_METRICS) | {"duration_s": 1.0})
    flights = results_of([none, none], scenario="hover")
    results = flights.results()
    assert results["worst"] is None and not results["of_paper"]
    figure = draw_distributions(flights.flown, of_paper=True)
    figure.canvas.draw()
    assert len(figure.axes) == 6


@pytest.mark.slow
def test_a_page_has_the_same_figures_as_its_file(tmp_path):
    study = new_sweep(
        "paper_collision", SweepDesign((parse_axis("reaction.name=none,reflex"),)), range(2),
        ("duration=25.2",),
    )  # fmt: skip
    with open_sweep(tmp_path / "s", study) as opened:
        page = fly_sweep(opened, workers=1)
        again = sweep_page(opened)
    assert json.loads((tmp_path / "s" / "sweep.json").read_text())["result"] == page.data
    assert again.data == page.data
    titles = [section.title for section in page.shown_by("page")]
    assert titles == [
        "All flights", "Crash rate for each setting", "Points",
        "Distributions", "Worst flight",
    ]  # fmt: skip
    (table,) = next(s.items for s in page.shown_by("terminal") if s.title == "Points")
    assert isinstance(table, Table) and table.head == [
        "reaction",
        "crashed",
        "fall [m]",
        "recovery [s]",
    ]
