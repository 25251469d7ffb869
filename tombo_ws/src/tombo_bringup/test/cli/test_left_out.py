"""`tombo diagnose` of logs that lack columns: an answer or one line that says why, never more."""

from __future__ import annotations

import csv
import gzip
from functools import cache
from pathlib import Path

import pytest
import yaml
from log_writers import SIZES, table_text
from measured_flights import LIVELY, as_log, fly, with_hidden

from tombo_logs.readers import csv_mapping

pytestmark = pytest.mark.slow

NANOBENCH = Path(__file__).resolve().parents[6] / "shared" / "data" / "flights"
MOTORS, IMU = {"rotor_speed", "rotor_command", "motor_command"}, {"gyro", "accel"}
GROUPS = [{"voltage"}, MOTORS, MOTORS | {"gyro"}, MOTORS | IMU]
OWN = ("position", "attitude", "gyro", "accel", "rotor_speed", "rotor_command", "voltage")


def shipped_text(name):
    """A shipped mapping as it is written."""
    folder = Path(csv_mapping.__file__).parent / "mappings"
    return yaml.safe_load((folder / f"{name}.yaml").read_text())


def refused_or_answered(tombo, *arguments):
    result = tombo("diagnose", *arguments, "--json")
    if result.code:
        assert (
            result.code == 2 and result.err.startswith("Error: ") and result.err.count("\n") == 1
        )
    else:
        assert result.json["verdict"] and "Traceback" not in result.err
    return result


@cache
def simulated():
    return table_text(as_log(fly(with_hidden({}), LIVELY[0], length=13.0)), OWN)


def without(text, columns):
    """The table without these columns."""
    rows = list(csv.reader(text.splitlines()))
    keep = [i for i, name in enumerate(rows[0]) if name not in columns]
    return "".join(",".join(row[i] for i in keep) + "\n" for row in rows)


@pytest.mark.parametrize("column", ["t", "position_x", "attitude_x"])
def test_a_simulated_log_without_a_column_that_is_needed(tombo, column):
    assert column in simulated().splitlines()[0].split(",")
    Path("flight.csv").write_text(without(simulated(), {column}))
    assert refused_or_answered(tombo, "flight.csv", "--mapping", "generic").code == 2


@pytest.mark.parametrize("group", GROUPS, ids=lambda g: "+".join(sorted(g)))
def test_a_simulated_log_without_a_group_of_channels(tombo, group):
    names = {name for channel in group & set(OWN) for name in SIZES[channel]}
    Path("flight.csv").write_text(without(simulated(), names))
    assert refused_or_answered(tombo, "flight.csv", "--mapping", "generic").code == 0


@pytest.mark.parametrize("group", [{"gyro"}, MOTORS], ids=lambda g: "+".join(sorted(g)))
@pytest.mark.skipif(not NANOBENCH.is_dir(), reason=f"real data absent: no {NANOBENCH}")
def test_a_real_log_without_a_channel(tombo, group):
    """Also without the vehicle: it is then compared with the suite's own, which it is not."""
    whole = gzip.decompress((NANOBENCH / "B2_circle_fast_rep1.csv.gz").read_bytes()).decode()
    rows = whole.splitlines()
    rows = [rows[0], *rows[600:1300]]
    mapping = csv_mapping.shipped()["nanobench"].channels
    names = {n for channel in group & set(mapping) for n in mapping[channel].columns}
    Path("flight.csv").write_text(without("\n".join(rows), names))
    refused_or_answered(tombo, "flight.csv", "--mapping", "nanobench")
    without_vehicle = {k: v for k, v in shipped_text("nanobench").items() if k != "airframe"}
    Path("no_vehicle.yaml").write_text(yaml.safe_dump(without_vehicle))
    refused_or_answered(tombo, "flight.csv", "--mapping", "no_vehicle.yaml")


def test_why_commands_were_taken_out_is_said(tombo, tmp_path):
    """With a vehicle that is not the suite's own, motors in another order leave no commands."""
    log = as_log(fly(with_hidden({}), LIVELY[0], length=13.0))
    rows = list(csv.reader(table_text(log, OWN).splitlines()))
    swap = str.maketrans("01", "10")
    rows[0] = [n.translate(swap) if n.startswith("rotor_") else n for n in rows[0]]
    (tmp_path / "flight.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    vehicle = {"name": "theirs", "mass": 1.3, "arm_length": 0.24, "rotor_radius": 0.12}
    (tmp_path / "lab.yaml").write_text(
        yaml.safe_dump({**shipped_text("generic"), "airframe": vehicle})
    )
    result = tombo("diagnose", "flight.csv", "--mapping", "lab.yaml")
    assert result.code == 0, result.err
    text = " ".join(result.out.split())
    for words in ("fault", "turns the vehicle otherwise", "rear_left, front_right"):
        assert words in text, text
