"""Bad input: one line with the name, the value and what is accepted; exit 2; nothing written."""

from __future__ import annotations

import pytest

from tombo import fly
from tombo_dynamics.errors import InputError


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("vehicle.mas=1", ("mas", "did you mean 'mass'", "accepted")),
        ("weather=1", ("weather", "accepted: ", "vehicle")),
        ("vehicle.mass=-1", ("vehicle.mass", "-1", "accepted", "0.01 to 10 [kg]")),
        ("vehicle.mass=nan", ("vehicle.mass", "nan", "[kg]")),
        ("vehicle.mass=.nan", ("vehicle.mass", "nan", "accepted")),
        ("vehicle.mass=1e400", ("vehicle.mass", "inf", "accepted")),
        ("vehicle.mass=11", ("vehicle.mass", "11", "accepted")),
        ("vehicle.mass=heavy", ("vehicle.mass", "heavy", "[kg]")),
        ("vehicle.mass=", ("vehicle.mass", "None", "[kg]")),
        ("vehicle.mass", ("vehicle.mass", "key=value")),
        ("=3", ("=3", "key=value")),
        ("vehicle=3", ("vehicle", "3", "mapping")),
        ("vehicle.mass={a: b", ("vehicle.mass", "YAML")),
        ("duration=2001-13-45", ("duration", "2001-13-45")),
        ("duration=0", ("duration", "0.1 to 3600")),
        ("react=perhaps", ("react", "perhaps", "true or false")),
        ("reaction.name=jump", ("reaction.name", "jump", "bounce")),
        ("disturbances=some", ("disturbances", "some", "true or false")),
        ("effects=3", ("effects", "3", "mapping")),
        ("effects.gusts=3", ("effects.gusts", "3", "mapping")),
        ("effects.gust.deviation=1", ("gust", "did you mean 'gusts'")),
        ("effects.gusts.size=1", ("gusts", "size", "accepted: deviation")),
        ("effects.gusts.deviation=99", ("effects.gusts.deviation", "99", "0 to 5 [m/s]")),
        ("detector.trigger=luck", ("detector.trigger", "luck", "region")),
        ("propeller.law=hooke", ("propeller.law", "hooke", "repaired")),
        ("propeller.conf=14", ("propeller.conf", "14", "0 to 13")),
        ("propeller.conf=2.5", ("propeller.conf", "2.5", "whole number")),
    ],
)
def test_a_bad_setting_is_refused_with_its_name(refused, setting, words):
    refused(("fly", "--set", setting), *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--conf", "14"), ("--conf", "14", "0 (rigid) to 13")),
        (("--conf", "-1"), ("--conf", "-1")),
        (("--conf", "soft"), ("--conf", "soft", "whole number")),
        (("--conf", "1"), ("propeller.conf", "1.82 N", "vehicle.mass")),
        (("--law", "hooke"), ("law", "hooke", "published")),
        (("--seed", "-1"), ("--seed", "-1", "from 0")),
        (("--seed", "1.5"), ("--seed", "1.5", "whole number")),
        (("--seed", "9" * 30), ("--seed", "9" * 30)),
        (("--seed", "1", "--seeds", "0:2"), ("--seed 1", "--seeds 0:2")),
        (("--seeds", "5"), ("--seeds", "5", "A:B")),
        (("--seeds", "a:b"), ("--seeds", "a:b", "A:B")),
        (("--seeds", "5:5"), ("--seeds", "5:5", "A < B")),
        (("--seeds", "7:3"), ("--seeds", "7:3", "A < B")),
        (("--seeds", "-3:4"), ("--seeds", "-3:4", "0 <= A")),
        (("--seeds", "0:4:2"), ("--seeds", "0:4:2", "A:B")),
        (("--seeds", ""), ("--seeds", "A:B")),
        (("--seeds", "0:1000000"), ("--seeds", "0:1000000", "at most")),
        (("-o", ""), ("-o", "accepted")),
        (("--fast",), ("--fast",)),
        (("a", "b"), ("b",)),
    ],
)
def test_options(refused, options, words):
    refused(("fly", *options), *words)


def test_an_unknown_scenario_is_named_beside_those_there_are(refused):
    words = ("papr_collision", "did you mean 'paper_collision'", "hover", "aggressive")
    refused(("fly", "papr_collision"), *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("vehicle: {mass: 1.2\neffects:", ("broken.yaml", "YAML", "line")),
        ("extends: hover\nvehicle: {mass", ("broken.yaml", "YAML")),
        ("", ("broken.yaml", "None")),
        ("- a\n- b\n", ("broken.yaml", "['a', 'b']")),
        ("extends: broken.yaml\n", ("broken.yaml", "extends itself")),
        ("extends: nowhere\n", ("nowhere",)),
        ("extends: hover\nvehicle: {mass: .nan}\n", ("vehicle.mass", "nan")),
        ("extends: hover\nunit: inch\n", ("unit", "accepted")),
        ("1: 2\n", ("1", "accepted")),
        ("&a [*a, *a]", ("broken.yaml",)),
        ("\t", ("broken.yaml",)),
        ("a: !!python/object/apply:os.system [true]", ("broken.yaml",)),
    ],
)
def test_scenario_files(refused, tmp_path, text, words):
    (tmp_path / "broken.yaml").write_text(text)
    refused(("fly", "broken.yaml"), *words)


def test_files_that_extend_each_other(refused, tmp_path):
    (tmp_path / "a.yaml").write_text("extends: b.yaml\n")
    (tmp_path / "b.yaml").write_text("extends: a.yaml\n")
    refused(("fly", "a.yaml"), "extends itself")


def test_a_folder_a_missing_and_a_binary_file_as_scenario(refused, tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary.yaml").write_bytes(bytes(range(256)))
    refused(("fly", "folder"), "folder", "accepted")
    refused(("fly", "missing.yaml"), "missing.yaml", "does not exist")
    refused(("fly", "binary.yaml"), "binary.yaml")


def test_a_key_with_an_escape_code_cannot_reach_the_terminal(refused):
    refused(("fly", "--set", "\x1b[31mred=1"), r"\x1b[31mred")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("propeller", "--conf", "soft"), ("--conf", "soft")),
        (("propeller", "--rpm", "-5"), ("--rpm", "-5", "accepted")),
        (("propeller", "--rpm", "17000", "--conf", "1"), ("1",)),
        (("propeller", "moduly"), ("moduly", "moduli")),
        (("flie",), ("flie", "fly", "scenarios")),
        (("--loud",), ("--loud",)),
    ],
)
def test_other_commands(refused, arguments, words):
    refused(arguments, *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("arena", "--reactions", "policy:nofile.json"), ("nofile.json", "accepted")),
        (("fly", "--reaction", "policy"), ("reaction.network", "accepted")),
        (("sweep", "pole", "vehicle.mass=1.1,1.1", "--seeds", "0:1"), ("vehicle.mass", "1.1")),
        (("fly", "--import", "yours.py"), ("--import 'yours.py'", "no such file")),
        (("sweep", "pole", "vehicle.mass=1.1,1.2", "--seeds", "0:1", "--scheduler", "127.0.0.1"),
         ("127.0.0.1", "accepted")),
    ],
)  # fmt: skip
def test_what_can_not_be_done_is_refused_before_anything_is_flown(refused, arguments, words):
    refused(arguments, *words)


def test_broken_parameters_start_no_node(refused, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text("sim:\n  ros__parameters: {vehicle: {mass: [}}\n", encoding="utf-8")
    refused(("up", "--params", str(path)), "broken.yaml", "not valid YAML at line 2")


@pytest.mark.parametrize("seed", [-1, 1.5, "3"])
def test_a_seed_from_python_is_checked(seed):
    with pytest.raises(InputError, match=r"seed.*accepted"):
        fly("hover", seed=seed)
