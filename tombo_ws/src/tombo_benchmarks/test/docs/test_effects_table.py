"""docs/effects.md says what the registry says."""

import pytest

from tombo_benchmarks.docs.tables import STAGES, effects_markdown
from tombo_dynamics.effects import REGISTRY, Stage


def test_every_stage_has_a_heading():
    assert set(STAGES) == set(Stage)


@pytest.mark.parametrize("name", REGISTRY)
def test_every_effect_is_there_with_each_of_its_parameters(name):
    section = effects_markdown().split(f"### `{name}`\n")[1].split("\n### ")[0].split("\n## ")[0]
    assert REGISTRY[name].doc.splitlines()[0] in section
    assert REGISTRY[name].signature in section
    for p in REGISTRY[name].theta:
        assert f"| `{p.name}` | {p.unit} |" in section
        assert p.doc in section
