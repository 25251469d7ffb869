"""The memory of a vehicle: its parts neither overlap nor leave gaps."""

import ast
import dataclasses
import inspect
import itertools
import math
import re

import numpy as np
import pytest

from tombo_dynamics import plant
from tombo_dynamics.plant import DELAY_TICKS, PLANT_SIZE, PLANT_SIZES, P, V, new_plant, part
from tombo_dynamics.vehicle import VehicleParams


def documented_sizes():
    """Read the sizes off the docstrings under the fields: '4: rotor speeds', '512 x 8: ...'."""
    tree = ast.parse(inspect.getsource(plant))
    record = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "_Plant")
    body = record.body
    sizes = {}
    for field, doc in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign):
            numbers = re.match(r"(\d+)(?: x (\d+))?:", doc.value.value)
            sizes[field.target.id] = math.prod(int(n) for n in numbers.groups() if n)
    return sizes


def test_parts_follow_each_other_without_overlap_or_gap(vehicle):
    memory = np.zeros(PLANT_SIZE)
    for name in P._fields:
        part(memory, name)[:] += 1.0
    for index in V:
        memory[index] += 1.0
    assert (memory == 1.0).all()


def test_sizes_are_those_of_the_documentation():
    assert documented_sizes() == PLANT_SIZES._asdict()
    assert PLANT_SIZES.delay == 4 * DELAY_TICKS


def test_every_vehicle_parameter_is_at_its_index():
    values = {f.name: (i + 1) * 1e-3 for i, f in enumerate(dataclasses.fields(VehicleParams))}
    memory = new_plant(VehicleParams(**values))
    assert {name: memory[getattr(V, name)] for name in V._fields} == values


def test_a_new_vehicle_is_upright_at_the_origin(vehicle):
    memory = new_plant(vehicle)
    assert part(memory, "body") == pytest.approx([0.0] * 9 + [1.0] + [0.0] * 3)
    rest = np.delete(memory[: P.work + PLANT_SIZES.work], P.body + 9)
    assert not rest.any()


def test_a_part_is_a_view(vehicle):
    memory = new_plant(vehicle)
    part(memory, "wind")[1] = 4.0
    assert memory[P.wind + 1] == 4.0
