"""An extended model: its content, refused input, and its file."""

import math
from dataclasses import replace

import pytest
import yaml

from tombo_diagnosis.diagnosis import VERDICTS, Cause, Diagnosis, FlightSummary
from tombo_diagnosis.extend_model import model_of
from tombo_dynamics.effects import check_theta
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import (
    FittedParameter,
    Gain,
    model_from_text,
    model_text,
    read_model,
    write_model,
)

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
    known = replace(DRAG, theta=(DRAG.theta[0],), covariance=((1e-4,),))  # NaN equals nothing
    written = model(WIND, known)
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
        ("value: 0.45, ", "", "d_xy.value: nan"),
        ("unit: N s/m", "unit: kg", "d_xy.unit: 'kg'; accepted: N s/m"),
        ("tombo_model: 1", "tombo_model: 2", "tombo_model: 2; accepted: 1"),
        ("tombo_model: 1", "model: 1", "it is not a model"),
        ("origin:", "orgin:", "'orgin'.*origin"),
        ("effects:", "effects: 3\nnotes:", "key 'notes' twice"),
    ],
)
def test_a_bad_file_is_refused_by_name(old, new, words):
    with pytest.raises(InputError, match=words) as caught:
        model_from_text(changed(old, new), "it")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "3", "a: b", "{", "tombo_model: 1\neffects: 3\n..."])
def test_what_is_no_model_is_refused(text, tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"model\.yaml"):
        read_model(path)
