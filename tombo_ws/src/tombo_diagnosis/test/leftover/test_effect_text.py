"""The effect that is written for a leftover runs, and gives the force that was fitted."""

import runpy

import numpy as np
import pytest

from tombo_diagnosis.leftover.leftover import Contribution, effect_text
from tombo_diagnosis.leftover.terms import Extent, force_terms, moment_terms
from tombo_dynamics.effect_registry import Registry
from tombo_dynamics.effects import registry
from tombo_dynamics.effects.compose import new_plant
from tombo_dynamics.rotation import rotation_matrix
from tombo_dynamics.vehicle import VehicleParams

PLACES = np.array([[-1.5, -1.0], [2.0, 1.2]])
DICTIONARIES = {"force": force_terms(Extent(PLACES, 15.2)), "moment": moment_terms()}


def plant_and_state():
    """Return a plant somewhere in flight, and the variables of the terms there."""
    plant = new_plant(VehicleParams())
    q = np.array([0.1, -0.2, 0.5, 0.8])
    plant.state.attitude = q / np.linalg.norm(q)
    rotation = np.zeros((3, 3))
    rotation_matrix(plant.state.attitude, rotation)
    plant.rotation = rotation
    plant.state.position = (0.7, -0.4, 1.1)
    plant.state.velocity = (1.2, -0.8, 0.3)
    plant.state.rates = (0.5, -0.7, 0.2)
    plant.airspeed = rotation.T @ plant.state.velocity
    plant.rotors[0].thrust = 12.5
    plant.ticks, plant.tick_length = 7000, 1e-3
    plant.supply.voltage = 14.9
    names = ("x", "y", "z", "vx", "vy", "vz", "u", "v", "w", "p", "q", "r")
    values = [
        *plant.state.position, *plant.state.velocity, *plant.airspeed, *plant.state.rates,
    ]  # fmt: skip
    state = {name: np.array([float(v)]) for name, v in zip(names, values, strict=True)}
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    more = {"yaw": yaw, "t": 7.0, "thrust": 12.5, "voltage": 14.9}
    return plant, state | {n: np.array([v]) for n, v in more.items()}, rotation[None]


def run(text, tmp_path, monkeypatch, **theta):
    """Return the force and moment that the text's effect adds, by a registry of its own."""
    own = Registry("effect", leading=2, prepare=lambda function: function)
    monkeypatch.setattr(registry, "effect", own.effect)
    path = tmp_path / "leftover.py"
    path.write_text(text)
    function = runpy.run_path(str(path))["leftover"]
    (result,) = own.values()
    plant, _, _ = plant_and_state()
    function(plant, np.zeros(9), *(theta.get(p.name, p.typical) for p in result.theta))
    return np.array(plant.force), np.array(plant.moment), result


@pytest.mark.slow
def test_every_term_is_written_as_it_was_fitted(tmp_path, monkeypatch):
    _, state, rotation = plant_and_state()
    for quantity, terms in DICTIONARIES.items():
        for term in terms:
            text = effect_text([Contribution(quantity, term, 0.25)])
            force, moment, _ = run(text, tmp_path, monkeypatch)
            expected = 0.25 * term.values(state, rotation)[0]
            got, other = (force, moment) if quantity == "force" else (moment, force)
            assert got == pytest.approx(expected, rel=1e-6, abs=1e-9), term.name
            assert not other.any(), term.name


def test_a_sum_of_terms_is_one_effect_that_is_nothing_at_its_null(tmp_path, monkeypatch):
    names = {
        "force": ("constant in map x", "spring to a point", "dry drag in the disc plane",
                  "thrust with time", "wall at a heading of 60 deg"),
        "moment": ("sine of yaw", "constant in map y"),
    }  # fmt: skip
    parts = [
        Contribution(quantity, next(t for t in DICTIONARIES[quantity] if t.name == name), value)
        for quantity, own in names.items()
        for name, value in zip(own, (0.3, -1.2, -0.4, -0.006, 2.0), strict=False)
    ]
    text = effect_text(parts)
    _, state, rotation = plant_and_state()
    force, moment, result = run(text, tmp_path, monkeypatch)
    for quantity, got in (("force", force), ("moment", moment)):
        own = [p for p in parts if p.quantity == quantity]
        expected = sum(p.value * p.term.values(state, rotation)[0] for p in own)
        assert got == pytest.approx(expected, rel=1e-3)
    null = {p.name: p.null for p in result.theta}
    force, moment, _ = run(text, tmp_path, monkeypatch, **null)
    assert not force.any() and not moment.any()
    assert max(map(len, text.splitlines())) <= 120


@pytest.mark.slow
def test_the_text_compiles_into_the_registry(tmp_path):
    import subprocess
    import sys

    terms = [t for t in DICTIONARIES["force"] if t.name in ("spring to a point", "quadratic drag")]
    (tmp_path / "leftover.py").write_text(
        effect_text([Contribution("force", t, -0.5) for t in terms])
    )
    check = (
        "import numpy as np, leftover\n"
        "from tombo_dynamics.effects import REGISTRY\n"
        "from tombo_dynamics.effects.compose import new_plant\n"
        "from tombo_dynamics.vehicle import VehicleParams\n"
        "plant = new_plant(VehicleParams())\n"
        "plant.rotation = np.eye(3)\n"
        "plant.state.position = (1.0, 2.0, 3.0)\n"
        "found = REGISTRY['leftover']\n"
        "found.function(plant, np.zeros(9), *(p.typical for p in found.theta))\n"
        "print(list(plant.force))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", check], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert eval(done.stdout) == pytest.approx([-0.5, -1.0, -1.5])
