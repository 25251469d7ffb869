"""docs/model.md has the vehicle's parameters as they are in the record."""

import dataclasses
from pathlib import Path

import pytest

from tombo_dynamics.vehicle import ROTOR_NAMES, SPIN, VehicleParams

DOCS = Path(__file__).parents[4] / "docs"


@pytest.mark.parametrize("field", dataclasses.fields(VehicleParams), ids=lambda f: f.name)
def test_every_vehicle_parameter_stands_there_with_value_and_source(field):
    meta = field.metadata
    cells = [f"`{field.name}`", f"{field.default:g}", meta["unit"], meta["doc"], meta["source"]]
    row = f"| {' | '.join(cells)} |"
    assert row in (DOCS / "model.md").read_text().splitlines()


def test_no_parameter_stands_there_that_is_gone():
    rows = [x for x in (DOCS / "model.md").read_text().splitlines() if x.startswith("| `")]
    table = {row.split("`")[1] for row in rows if row.count("|") == 6}
    assert table == {f.name for f in dataclasses.fields(VehicleParams)}


@pytest.mark.parametrize("i, name", enumerate(ROTOR_NAMES))
def test_conventions_have_the_rotors_in_order(i, name):
    page = (DOCS / "conventions.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith(f"| {i} | {name} |"))
    assert ("counter-clockwise" in row) == (SPIN[i] > 0.0)
    assert ("front" in name) == ("+x" in row)
    assert ("left" in name) == ("+y" in row)
