"""`tombo live`: accepted sources, and the message for others."""

import sys

import pytest

from tombo_bringup.cli import live_command
from tombo_dynamics.errors import InputError


@pytest.mark.parametrize("source", ["absent.mcap", "runs/absent", "absent.yaml", "absent"])
def test_a_source_that_is_not_there_is_named(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"'{source}'.*accepted"):
        live_command._flight(source, 0, None, {})


@pytest.mark.slow
def test_a_scenario_is_flown_from_its_file(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text("extends: hover\nduration: 0.2\n")
    assert live_command._flight(str(path), 1, None, {}).scenario["duration"] == 0.2


@pytest.mark.parametrize("absent", ["starlette", "websockets", "foxglove"])
def test_a_library_of_the_web_that_is_absent_is_named(tombo, monkeypatch, absent):
    for name in [name for name in sys.modules if name.startswith(("tombo_web", f"{absent}."))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, absent, None)
    result = tombo("live", "absent.mcap", "--foxglove", "1")
    assert result.code == 2 and "make live" in result.err
