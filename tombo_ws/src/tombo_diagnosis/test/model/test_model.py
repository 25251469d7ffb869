"""An extended model: its content, refused input, and its file."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tombo_diagnosis.diagnosis import VERDICTS, Cause, Diagnosis, FlightSummary
from tombo_diagnosis.extend_model import model_of
from tombo_dynamics.effects import REGISTRY, check_theta
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import (
    FittedEffect,
    FittedParameter,
    Gain,
    Model,
    ModelSource,
    Origin,
    merge_effects,
)
from tombo_flight.model_file import model_from_text, model_text, read_model, write_model

DRAG = Cause(
    "linear_rotor_drag",
    (
        FittedParameter("d_xy", "N s/m", 0.3, 0.45, 0.44, 0.46),
        FittedParameter("d_z", "N s/m", 0.1, 0.12, 0.05, math.nan),
    ),
    0.98,
    "force against the velocity",
    ((1e-4, 2e-6), (2e-6, 3e-4)),
)
WIND = Cause(
    "steady_wind", (FittedParameter("east", "m/s", 0.0, 1.5, 1.2, 1.8),), 0.9, "a constant force"
)
GAIN = Gain("force x", "m/s^2", "one step", 0.2, 0.05, 0.75, 0.7, 0.8, 6)
FLIGHT = FlightSummary("a", "a.mcap: MCAP", 31.0, 28.0, "imu", ("current",))


SUMMARY = "More drag than thought: 'half' as much again.\nÜber alles."


def diagnosis(*causes, verdict="named"):
    return Diagnosis(
        verdict, causes, (), None, (GAIN,), (), (), (FLIGHT,), (), 0.97, SUMMARY,
        ("one battery only",), "model.yaml",
    )  # fmt: skip


def model(*causes, base=None, **more):
    result = diagnosis(*(causes or (DRAG,)), **more)
    return model_of(result, tool="tombo 0.1", date="2025-01-02", scenario="no_obstacle", base=base)


def test_what_was_named_stands_in_the_file_with_its_origin(tmp_path):
    path = tmp_path / "model.yaml"
    write_model(path, model(DRAG, WIND))
    values = yaml.safe_load(path.read_text())
    d_xy = values["effects"]["linear_rotor_drag"]["parameters"]["d_xy"]
    assert d_xy == {"unit": "N s/m", "nominal": 0.3, "value": 0.45, "low": 0.44, "high": 0.46}
    assert values["effects"]["linear_rotor_drag"]["covariance"] == [[1e-4, 2e-6], [2e-6, 3e-4]]
    assert values["effects"]["steady_wind"]["parameters"]["east"]["value"] == 1.5
    origin = values["origin"]
    assert origin["verdict"] == "named" and origin["scenario"] == "no_obstacle"
    assert origin["date"] == "2025-01-02" and origin["tool"] == "tombo 0.1"
    assert [f["source"] for f in origin["flights"]] == ["a.mcap: MCAP"]
    assert values["gain"][0]["reduction"] == 0.75
    assert values["notes"] == ["one battery only"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.yaml"]


def test_what_was_written_is_read_back(tmp_path):
    path = tmp_path / "model.yaml"
    written = model(WIND)
    write_model(path, written)
    assert read_model(path) == written


@pytest.mark.parametrize("verdict", sorted(set(VERDICTS) - {"named", "partly_explained"}))
def test_a_verdict_that_names_nothing_extends_nothing(verdict):
    with pytest.raises(InputError, match=f"'{verdict}' names no effect.*named or partly"):
        model(DRAG, verdict=verdict)


def test_part_of_the_truth_is_put_in_and_nothing_is_not():
    assert model(DRAG, verdict="partly_explained").effects["linear_rotor_drag"]["d_xy"] == 0.45
    with pytest.raises(InputError, match="names no effect"):
        model_of(diagnosis(), tool="", date="", scenario="")


@pytest.mark.parametrize("value", [99.0, -99.0])
def test_a_value_out_of_bounds_is_clipped_and_noted(value):
    wild = replace(WIND, theta=(FittedParameter("east", "m/s", 0.0, value, 1.0, 2.0),))
    extended = model(wild)
    assert extended.effects["steady_wind"]["east"] == math.copysign(15.0, value)
    assert f"steady_wind.east: {value:g} was fitted" in extended.notes[0]
    check_theta(extended.effects, "effects")


def test_a_cause_that_can_t_be_flown_is_refused():
    for cause in (
        replace(WIND, effect="ghosts"),
        replace(WIND, theta=(FittedParameter("up", "m/s", 0.0, 1.0, 0.0, 2.0),)),
        replace(WIND, theta=(FittedParameter("east", "m/s", 0.0, math.nan, 0.0, 2.0),)),
    ):
        with pytest.raises(InputError):
            model(cause)


def test_a_model_made_from_a_model_keeps_what_it_held():
    base = model(DRAG)
    finer = replace(DRAG, theta=(FittedParameter("d_xy", "N s/m", 0.45, 0.5, 0.4, 0.6),))
    extended = model(finer, WIND, base=base)
    assert extended.effects == {
        "linear_rotor_drag": {"d_z": 0.12, "d_xy": 0.5},
        "steady_wind": {"east": 1.5},
    }
    assert extended.additions[0].covariance == ()  # of two fits: no covariance in common
    assert extended.origin.extends == "model.yaml"
    assert model(WIND, base=base).additions[0] == base.additions[0]


def test_is_laid_over_a_scenario_parameter_by_parameter():
    scenario = {"steady_wind": {"east": 1.0, "north": 2.0}, "imu_noise": {"gyro": 0.01}}
    before = {name: dict(values) for name, values in scenario.items()}
    over = merge_effects(scenario, model(WIND))
    assert over == {"steady_wind": {"east": 1.5, "north": 2.0}, "imu_noise": {"gyro": 0.01}}
    assert scenario == before


@st.composite
def models(draw):
    texts = st.text(max_size=20)
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    additions = []
    for name in draw(st.lists(st.sampled_from(sorted(REGISTRY)), min_size=1, unique=True)):
        chosen = REGISTRY[name].theta[: draw(st.integers(1, len(REGISTRY[name].theta)))]
        theta = tuple(
            FittedParameter(
                p.name, p.unit, draw(numbers), draw(st.floats(*p.bounds)), *[draw(numbers)] * 2
            )
            for p in chosen
        )
        matrix = [tuple(draw(numbers) for _ in theta) for _ in theta]
        additions.append(FittedEffect(name, theta, draw(st.floats(0.0, 1.0)), tuple(matrix)))
    flights = tuple(ModelSource(draw(texts), draw(texts), draw(numbers), "imu") for _ in range(2))
    origin = Origin(*[draw(texts) for _ in range(3)], 0.5, draw(texts), draw(texts), "", flights)
    gain = (Gain(draw(texts), "N", "1 s", *[draw(numbers) for _ in range(5)], 3),)
    return Model(tuple(additions), origin, gain, tuple(draw(st.lists(texts, max_size=3))))


@pytest.mark.slow
@given(models())
def test_any_model_survives_its_file(made):
    assert model_from_text(model_text(made), "it") == made


def test_numbers_of_numpy_are_written_as_numbers():
    east = FittedParameter("east", "m/s", 0.0, *np.array([1.5, 1.2, np.inf]))
    odd = replace(WIND, theta=(east,), covariance=np.eye(1))
    read = model_from_text(model_text(model(odd)), "it")
    assert read.effects == {"steady_wind": {"east": 1.5}}
    assert math.isnan(read.additions[0].theta[0].high)
    assert read.additions[0].covariance == ((1.0,),)


def test_a_file_that_has_lost_its_end_is_never_taken():
    lines = model_text(model(DRAG, WIND)).splitlines()
    for n in range(len(lines)):
        with pytest.raises(InputError, match="it"):
            model_from_text("\n".join(lines[:n]), "it")


def changed(old, new):
    text = model_text(model(DRAG))
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("linear_rotor_drag:", "linear_rotor_darg:", "effects.*linear_rotor_drag"),
        ("d_xy:", "d_yx:", "'d_yx'"),
        ("value: 0.45", "value: 1e9", "linear_rotor_drag.d_xy.value: 1000000000.0 is out of"),
        ("value: 0.45", "value: .nan", "d_xy.value: nan"),
        ("value: 0.45", "value: much", "d_xy.value: 'much'"),
        ("value: 0.45, ", "", "d_xy.value: None"),
        ("low: 0.44", "low: .inf", "d_xy.low: inf"),
        ("unit: N s/m", "unit: kg", "d_xy.unit: 'kg'; accepted: N s/m"),
        ("confidence: 0.98", "confidence: 2", "confidence: 2"),
        ("[0.0001, 2.0e-06]", "[0.0001]", "covariance: accepted: 2 rows of 2"),
        ("[0.0001, 2.0e-06]", "[0.0001, .nan]", "covariance: nan"),
        ("tombo_model: 1", "tombo_model: 2", "tombo_model: 2; accepted: 1"),
        ("tombo_model: 1", "model: 1", "it is no model"),
        ("origin:", "orgin:", "'orgin'.*origin"),
        ("  date:", "  dat:", "'dat'.*date"),
        ("effects:", "effects: 3\nnotes:", "key 'notes' twice"),
        ("notes:", "notes: [", "it is not valid YAML"),
        ("flights: 6", "flights: 6.5", "flights: 6.5 is not a whole"),
    ],
)
def test_a_bad_file_is_refused_by_name(old, new, words):
    with pytest.raises(InputError, match=words) as caught:
        model_from_text(changed(old, new), "it")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["", "3", "[]", "a: b", "\x00", "{", "tombo_model: 1\n...", "tombo_model: 1\neffects: 3\n..."],
)
def test_what_is_no_model_is_refused(text, tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"model\.yaml"):
        read_model(path)


def test_files_that_can_t_be_read_or_written_are_reported(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml' can't be read"):
        read_model(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="can't be read"):
        read_model(tmp_path)
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no text"):
        read_model(tmp_path / "bytes.yaml")
    with pytest.raises(InputError, match="can't be written"):
        write_model(tmp_path / "no" / "model.yaml", model())
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="can't be written"):
        write_model(tmp_path / "folder", model())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bytes.yaml", "folder"]
