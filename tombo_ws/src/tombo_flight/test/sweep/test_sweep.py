"""A sweep is its single flights, whoever flew them, and however often it was interrupted."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import flight_summary
from tombo_flight.process import study_folder
from tombo_flight.process.study import Task, begin_flying, fly_batch
from tombo_flight.process.study_folder import OUTCOME, RESULT, fly_study, open_study, read_head
from tombo_flight.scenario import load_scenario
from tombo_flight.sweep.page import analyse_sweep
from tombo_flight.sweep.study import (
    FIGURES,
    LEFT_OUT,
    WALL_COLUMNS,
    SweepDesign,
    new_sweep,
    parse_axis,
    row_of,
)

AXES = ("vehicle.mass=1.1,1.3", "mission.height=1.5:2.5:0.5")
SHORT = ("duration=1.5",)


def study(seeds=range(3), axes=AXES, settings=SHORT, name="hover"):
    return new_sweep(name, SweepDesign(tuple(parse_axis(text) for text in axes)), seeds, settings)


def flown(folder, what=None, **options):
    what = what or study()
    with open_study(folder, what) as opened:
        assert (
            fly_study(opened, partial(analyse_sweep, what), **{"workers": 1, **options})
            is not None
        )
    return pq.read_table(folder / "flights.parquet").drop_columns(list(WALL_COLUMNS))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, flown(folder)


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
def test_the_table_says_units_and_what_was_flown(whole):
    folder, table = whole
    assert table.schema.field("max_tilt_rad").metadata == {b"unit": b"rad"}
    said = json.loads(table.schema.metadata[b"tombo"])
    assert said["axes"][0] == {**said["axes"][0], "key": "vehicle.mass", "levels": ["1.1", "1.3"]}
    assert said["tombo_version"].startswith("0.")
    head = read_head(folder, "sweep")
    assert {key: value for key, value in head.items() if key not in (OUTCOME, RESULT)} == said


@pytest.mark.slow
def test_every_figure_of_a_summary_has_a_column():
    summary = flight_summary(fly_scenario(load_scenario("hover", ["duration=0.1"]), 0))
    assert set(summary) == {*FIGURES, *LEFT_OUT}


@pytest.mark.slow
def test_a_sweep_goes_on_where_it_was_stopped_and_flies_nothing_twice(
    tmp_path, whole, monkeypatch
):
    monkeypatch.setattr(study_folder, "PART_FLIGHTS", 4)  # whole parts, and one that is not
    flights = []

    def count(self, flown):
        flights.extend(task.key for task, _ in flown)
        keep(self, flown)

    keep = study_folder.StudyFolder.keep
    monkeypatch.setattr(study_folder.StudyFolder, "keep", count)
    for limit in (5, 9, 14):
        with open_study(tmp_path / "s", study()) as opened:
            assert opened.kept == len(flights)
            stop = partial(lambda n: len(flights) >= n, limit)
            assert fly_study(opened, partial(analyse_sweep, study()), workers=1, stop=stop) is None
    journal = tmp_path / "s" / "flights.jsonl"
    part = tmp_path / "s" / "parts" / "000000.parquet"
    row = pq.read_table(part).to_pylist()[0]
    with journal.open("a") as file:  # killed between the part and the end of its lines
        file.write("\n" + json.dumps(["sweep", row.pop("flight"), row]))
        file.write('\n["sweep", 17, {"po')  # torn when the process was killed
    with open_study(tmp_path / "s", study()) as opened:
        assert (
            fly_study(opened, partial(analyse_sweep, study()), workers=1).data["outcome"]
            == "0 of 18 crashed"
        )
    assert not part.parent.exists() and not journal.exists()

    assert sorted(flights) == list(range(18))
    table = pq.read_table(tmp_path / "s" / "flights.parquet").drop_columns(list(WALL_COLUMNS))
    assert table.equals(whole[1])


@pytest.mark.slow
def test_a_sweep_that_was_killed_gives_the_same_table(tmp_path, whole):
    code = "from tombo_bringup.cli.main import run; run()"
    words = ["sweep", "hover", *AXES, "--seeds", "0:3", "--set", *SHORT, "-o", "s"]
    command = [sys.executable, "-c", code, *words, "--workers", "1"]
    process = subprocess.Popen(command, cwd=tmp_path, start_new_session=True)
    journal = tmp_path / "s" / "flights.jsonl"
    end = time.monotonic() + 120.0
    while not (journal.is_file() and journal.read_bytes().count(b"\n") >= 4):
        assert time.monotonic() < end and process.poll() is None
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    there = journal.read_bytes().count(b"\n") if journal.is_file() else 18

    again = subprocess.run(
        [*command, "--json"], cwd=tmp_path, check=True, capture_output=True, text=True
    )

    assert json.loads(again.stdout)["flown"] == 18 - there
    table = pq.read_table(tmp_path / "s" / "flights.parquet").drop_columns(list(WALL_COLUMNS))
    assert table.to_pylist() == whole[1].to_pylist()


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

        table = flown(tmp_path / "s", scheduler=cluster.scheduler_address, progress=kill_one)

    assert told
    assert table.equals(whole[1])


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"requirements-study\.txt"):
        flown(tmp_path / "s", scheduler="tcp://127.0.0.1:1")


@pytest.mark.slow
def test_a_point_that_can_not_be_flown_is_a_row_that_says_why(tmp_path):
    axes = ("vehicle.arm_length=0.2,0.35", "vehicle.mass=1.2,4.0")
    table = flown(tmp_path / "s", study(range(1), axes)).to_pylist()
    assert [row["error"] is None for row in table] == [True, False, True, False]
    assert "vehicle.mass 4 kg" in table[1]["error"]
    page = (tmp_path / "s" / "sweep.html").read_text()
    assert "vehicle.mass=4.0" in page and "vehicle.mass 4 kg" in page


def test_a_value_that_is_never_accepted_is_refused_before_the_first_flight():
    with pytest.raises(InputError, match=r"vehicle\.mass"):
        study(axes=("vehicle.mass=1.2,-1",))


@pytest.mark.slow
def test_a_folder_with_another_sweep_or_other_things_is_refused(tmp_path, whole):
    with pytest.raises(InputError, match="another seeds"), open_study(whole[0], study(range(4))):
        pass
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"), open_study(tmp_path, study()):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("cut", [0, 100])
def test_a_table_that_is_no_table_is_named_and_stays(tmp_path, whole, cut):
    shutil.copytree(whole[0], tmp_path / "s")
    table = tmp_path / "s" / "flights.parquet"
    table.write_bytes(table.read_bytes()[: -cut or None] if cut else b"mine")
    damaged = table.read_bytes()
    with pytest.raises(InputError, match=r"flights\.parquet.*accepted"):
        flown(tmp_path / "s")
    assert table.read_bytes() == damaged


def test_a_sweep_of_which_nothing_was_flown_leaves_nothing(tmp_path):
    for numbered in (False, True):
        with (
            pytest.raises(InputError, match="reached"),
            open_study(tmp_path / "s", study(), numbered=numbered) as opened,
        ):
            assert opened.folder.is_dir()
            raise InputError("it can't be reached")
    assert list(tmp_path.iterdir()) == []


def test_two_processes_can_not_fly_the_same_sweep(tmp_path):
    with (
        open_study(tmp_path, study()),
        pytest.raises(InputError, match="another process"),
        open_study(tmp_path, study()),
    ):
        pass


@pytest.mark.slow
def test_the_command_of_a_flight_flies_it_again():
    what = study(range(5, 7), ("propeller.conf=0,13", "mission.height=1.5:1.6:0.05"))
    words = shlex.split(what.command(9))
    settings = [word for before, word in pairwise(words) if before == "--set"]
    alone = fly_scenario(load_scenario(words[2], settings), int(words[words.index("--seed") + 1]))
    point, seed = what.place(9)
    begin_flying(what)
    ((_, row),) = fly_batch([Task(9, point, seed)])
    ours = row_of(flight_summary(alone))
    assert seed == 6 and settings == ["duration=1.5", "propeller.conf=13", "mission.height=1.55"]
    assert {k: row[k] for k in ours if k not in WALL_COLUMNS} == {
        k: v for k, v in ours.items() if k not in WALL_COLUMNS
    }


@pytest.mark.slow
def test_failures_are_on_the_page_with_their_commands(tmp_path):
    what = study(range(2), ("vehicle.mass=1.2,1.25",), (), "rigid_propeller")
    table = flown(tmp_path / "s", what)
    crashed = int(np.sum(table.column("crashed").to_numpy(zero_copy_only=False)))
    assert crashed
    page = (tmp_path / "s" / "sweep.html").read_text()
    assert page.count("tombo fly rigid_propeller --seed") == crashed
    assert dataclasses.asdict(what)["scenario"] == "rigid_propeller"
    assert Path(tmp_path / "s" / "parts").exists() is False
