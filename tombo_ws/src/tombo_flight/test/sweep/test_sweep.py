"""A sweep is its single flights, whoever flew them, and however often it was interrupted."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tombo_collision.network import network_text
from tombo_collision.steering import ACTIONS, HIGH
from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import flight_summary
from tombo_flight.scenario import load_scenario
from tombo_flight.sweep.design import SweepDesign, parse_axis
from tombo_flight.sweep.folder import (
    OUTCOME,
    RESULT,
    SweepFolder,
    fly_sweep,
    open_sweep,
    read_head,
)
from tombo_flight.sweep.study import FIGURES, new_sweep, row_of

AXES = ("vehicle.mass=1.1,1.3", "mission.height=1.5:2.5:0.5")
SHORT = ("duration=1.5",)
LEFT_OUT = ("tombo_version", "model", "seed", "recorded_messages")
"""Keys of a summary that are equal for all flights, or have separate columns."""
WALL_COLUMNS = ("wall_time_s", "real_time_factor")
"""What differs between two sweeps of the same study."""


def study(seeds=range(3), axes=AXES, settings=SHORT, name="hover"):
    return new_sweep(name, SweepDesign(tuple(parse_axis(text) for text in axes)), seeds, settings)


def fly_table(folder, what=None, **options):
    what = what or study()
    with open_sweep(folder, what) as opened:
        assert fly_sweep(opened, **{"workers": 1, **options}) is not None
    return pq.read_table(folder / "flights.parquet").drop_columns(list(WALL_COLUMNS))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, fly_table(folder)


@pytest.mark.slow
def test_each_row_is_the_flight_of_its_settings(whole):
    _, table = whole
    rows = table.to_pylist()
    assert [row["flight"] for row in rows] == list(range(18))
    for row in (rows[0], rows[10]):
        settings = [f"{key}={row[key]!r}" for key in ("vehicle.mass", "mission.height")]
        scenario = load_scenario("hover", [*SHORT, *settings])
        alone = row_of(flight_summary(fly_scenario(scenario, row["seed"])))
        assert {key: row[key] for key in alone if key not in WALL_COLUMNS} == {
            key: value for key, value in alone.items() if key not in WALL_COLUMNS
        }


@pytest.mark.slow
def test_the_table_says_what_was_flown(whole):
    folder, table = whole
    said = json.loads(table.schema.metadata[b"tombo"])
    assert said["axes"][0] == {**said["axes"][0], "key": "vehicle.mass", "levels": ["1.1", "1.3"]}
    assert said["tombo_version"].startswith("0.")
    head = read_head(folder)
    assert {key: value for key, value in head.items() if key not in (OUTCOME, RESULT)} == said


@pytest.mark.slow
def test_every_figure_of_a_summary_has_a_column():
    summary = flight_summary(fly_scenario(load_scenario("hover", ["duration=0.1"]), 0))
    assert set(summary) == {*FIGURES, *LEFT_OUT}


@pytest.mark.slow
def test_a_sweep_goes_on_where_it_was_stopped_and_flies_nothing_twice(
    tmp_path, whole, monkeypatch
):
    flights = []

    def count(self, flown):
        flights.extend(task.key for task, _ in flown)
        keep(self, flown)

    keep = SweepFolder.keep
    monkeypatch.setattr(SweepFolder, "keep", count)
    for limit in (5, 9, 14):
        with open_sweep(tmp_path / "s", study()) as opened:
            assert opened.kept == len(flights)
            stop = partial(lambda n: len(flights) >= n, limit)
            assert fly_sweep(opened, workers=1, stop=stop) is None
    parts = tmp_path / "s" / "parts"
    torn = parts / ".000000017.parquet.unfinished"
    torn.write_bytes(b"PAR1")  # killed while it wrote
    kept_part = min(parts.glob("0*.parquet"))
    content = kept_part.read_bytes()
    table = fly_table(tmp_path / "s")
    assert not parts.exists()
    assert sorted(flights) == list(range(18))
    assert table.equals(whole[1])

    parts.mkdir()
    kept_part.write_bytes(content)  # killed between the table and the removal of its parts
    assert fly_table(tmp_path / "s").equals(whole[1])
    assert sorted(flights) == list(range(18))


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="Dask is not installed"
)
def test_dask_gives_the_same_table_even_if_a_worker_is_killed(tmp_path, whole):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        victims = [worker.pid for worker in cluster.workers.values()]
        told = []

        def kill_one(kept, left_s):
            if not told:
                os.kill(victims[0], signal.SIGKILL)
            told.append(kept)

        table = fly_table(tmp_path / "s", scheduler=cluster.scheduler_address, progress=kill_one)

    assert told
    assert table.equals(whole[1])


@pytest.mark.slow
def test_a_point_that_can_not_be_flown_is_a_row_that_says_why(tmp_path):
    axes = ("vehicle.arm_length=0.2,0.35", "vehicle.mass=1.2,4.0")
    table = fly_table(tmp_path / "s", study(range(1), axes)).to_pylist()
    assert [row["error"] is None for row in table] == [True, False, True, False]
    assert "vehicle.mass 4 kg" in table[1]["error"]
    page = (tmp_path / "s" / "sweep.html").read_text()
    assert "2 not flown" in page and "vehicle.mass 4 kg" in page


def test_a_value_that_is_never_accepted_is_refused_before_the_first_flight():
    with pytest.raises(InputError, match=r"vehicle\.mass"):
        study(axes=("vehicle.mass=1.2,-1",))


@pytest.mark.slow
def test_a_folder_with_another_sweep_or_other_things_is_refused(tmp_path, whole):
    with pytest.raises(InputError, match="another seeds"), open_sweep(whole[0], study(range(4))):
        pass
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"), open_sweep(tmp_path, study()):
        pass


def test_a_sweep_of_which_nothing_was_flown_leaves_nothing(tmp_path):
    for numbered in (False, True):
        with (
            pytest.raises(InputError, match="reached"),
            open_sweep(tmp_path / "s", study(), numbered=numbered) as opened,
        ):
            assert opened.folder.is_dir()
            raise InputError("it can't be reached")
    assert list(tmp_path.iterdir()) == []


def test_two_processes_can_not_fly_the_same_sweep(tmp_path):
    with (
        open_sweep(tmp_path, study()),
        pytest.raises(InputError, match="another process"),
        open_sweep(tmp_path, study()),
    ):
        pass


@pytest.mark.slow
def test_the_worst_flight_is_on_the_page_with_its_command(tmp_path):
    what = study(range(2), ("vehicle.mass=1.2,1.25",), (), "rigid_propeller")
    table = fly_table(tmp_path / "s", what).to_pandas()
    crashes = table[table["crashed"]]
    assert len(crashes)
    page = (tmp_path / "s" / "sweep.html").read_text()
    worst = crashes.loc[crashes["max_falling_distance_m"].idxmax()]
    result = read_head(tmp_path / "s")[RESULT]
    assert result["worst"]["flight"] == worst["flight"]
    assert result["worst"]["command"] == what.command(int(worst["flight"]))
    assert 'id="flight"' in page  # it is replayed in 3-D
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)  # nothing from elsewhere


@pytest.mark.slow
def test_cases_of_a_file_are_flown_with_their_settings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(
        "cases:\n  hover: {}\n  high: {scenario: hover, mission.height: 2.5}\n"
    )
    axes = ("vehicle.mass=1.2,1.3",)
    table = fly_table(tmp_path / "s", study(range(1), axes, SHORT, "mine.yaml,no_obstacle"))
    rows = table.to_pylist()
    assert [row["case"] for row in rows] == [
        n for n in ("hover", "high", "no_obstacle") for _ in "12"
    ]
    alone = fly_scenario(
        load_scenario("hover", [*SHORT, "mission.height=2.5", "vehicle.mass=1.3"]), 0
    )
    assert rows[3]["hover_rms_m"] == flight_summary(alone)["hover_rms_m"]
    assert rows[3]["scenario"] == "hover"


def test_the_collisions_of_the_suite_are_cases_and_refuse_a_second_one():
    what = new_sweep("collisions", SweepDesign(), range(1))
    scenarios = [what.scenario_at(point) for point in range(what.points)]
    assert len(scenarios) == 12
    speeds = [s.mission.approach_speed for s in scenarios]
    assert speeds[7:11] == [0.5, 0.9, 1.2, 1.5] and speeds[0] == 0.7
    assert scenarios[3].name == "pole"
    with pytest.raises(InputError, match="given twice"):
        new_sweep("collisions,pole", SweepDesign(), range(1))


def test_a_policy_is_named_with_its_network_and_an_unknown_reaction_is_refused(tmp_path):
    network = tmp_path / "net.json"
    network.write_text(network_text([np.zeros((ACTIONS, HIGH.size + 1))]))
    what = study(range(1), (f"reaction.name=reflex,policy:{network}",), (), "pole")
    assert what.scenario_at(1).reaction.name == "policy"
    assert f"reaction.network={network}" in what.command(1)
    for name in ("bounze", "policy:nothing.json"):
        with pytest.raises(InputError, match=r"accepted|did you mean"):
            study(range(1), (f"reaction.name=reflex,{name}",), (), "pole")


def test_points_of_a_drawn_design_have_seeds_of_their_own():
    axes = (parse_axis("vehicle.mass=norm(1.3,0.02)"),)
    what = new_sweep("hover,no_obstacle", SweepDesign(axes, "lhs", 4), range(10, 12), SHORT)
    seeds = [what.place(flight)[1] for flight in range(what.flights)]
    assert seeds == 2 * list(range(10, 18))  # both cases meet the same noise
