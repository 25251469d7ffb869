"""`tombo propeller beta` and `recovery`: files and words out, refusals in."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from films import write_folder, write_video
from suite_bench import names

from tombo_propeller.flap_video.synthetic_video import Scene, SyntheticVideo, reference_scene

SCENE = Scene(beta=math.radians(18.0), width=400, height=400, scale=1650.0, camera_height=6.0)
SCALE = ("--scale", "1.65")


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """Two windows of 18 deg as a folder, and slow frames of the same as a video."""
    folder = tmp_path_factory.mktemp("films")
    write_folder(SyntheticVideo(SCENE), 20, folder / "fast")
    write_video(SyntheticVideo(reference_scene(SCENE)), 32, folder / "slow.avi")
    return folder


def beta(tombo, *arguments):
    return tombo("propeller", "beta", *map(str, arguments))


@pytest.mark.slow
def test_a_film_gives_the_angle_with_its_interval_and_four_files(tombo, films, tmp_path):
    result = beta(tombo, films / "fast", "--reference", films / "slow.avi", "--camera-height",
                  "6000", "-o", tmp_path / "out")  # fmt: skip
    assert result.code == 0, result.err
    assert "All 2 windows: 18." in result.out or "All 2 windows: 17." in result.out
    assert names(tmp_path / "out") == {"beta.json", "beta.csv", "beta.png", "overlay.png"}
    rows = list(csv.DictReader((tmp_path / "out" / "beta.csv").open()))
    assert [float(r["time_s"]) for r in rows] == pytest.approx([4.5 / 960, 14.5 / 960], abs=1e-6)
    assert all(float(r["beta_low_deg"]) < 18.0 < float(r["beta_high_deg"]) for r in rows)
    assert cv2.imread(str(tmp_path / "out" / "overlay.png")).shape[1] > 900


@pytest.mark.slow
def test_json_alone_has_no_bare_number(tombo, films):
    values = beta(tombo, films / "fast", "--reference", films / "slow.avi", "--json").json
    assert values["beta"]["low_deg"] < values["beta"]["deg"] < values["beta"]["high_deg"]
    assert any("camera-height" in note for note in values["notes"])
    assert values["scale"]["source"] == "reference, spinning"
    straight = beta(tombo, films / "slow.avi", *SCALE, "--window", "32", "--json").json
    assert straight["beta"]["deg"] is None
    assert "at most" in straight["beta"]["words"]


@pytest.mark.slow
def test_the_speed_is_seen(tombo, films):
    values = beta(tombo, films / "fast", *SCALE, "--fps", "1920", "--json").json
    rpm = [w["rpm"] for w in values["windows"]]
    assert rpm == pytest.approx([2 * SCENE.speed * 30.0 / math.pi] * 2, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments, why",
    [
        (["fast"], "sources of the scale"),
        (["fast", *SCALE, "--marks", "0,0,9,9,9"], "2 sources"),
        (["fast", "--scale", "nan"], "finite"),
        (["fast", "--scale", "0"], "pixels per mm"),
        (["fast", "--scale", "0.7"], "radius by the scale"),
        (["fast", "--marks", "1,2,3"], "X1,Y1"),
        (["fast", *SCALE, "--nodus-radius", "120"], "nodus < tip"),
        (["fast", *SCALE, "--camera-height", "-3"], "camera-height"),
        (["fast", *SCALE, "--camera-height", "3"], "in mm, 222.2 to"),
        (["fast", *SCALE, "--camera-height", "2e6"], "1e+06"),
        (["fast", *SCALE, "--camera-height", "high"], "'--camera-height': 'high'"),
        (["fast", *SCALE, "--fps", "1e8"], "1e+07"),
        (["fast", *SCALE, "--window", "1"], "windows of 1"),
        (["fast", *SCALE, "--window", "21"], "20 frames"),
        (["fast", *SCALE, "--fps", "0"], "fps"),
        (["fast", "--reference-frames", "9:3"], "A below B"),
        (["fast", "--reference-frames", "90:95"], "no frames"),
        (["fast", "--reference", "none"], "reference"),
        (["fast", "--reference", "fast"], "the film itself"),
        (["none", *SCALE], "exists"),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "",
)
def test_bad_input_is_one_line_and_exit_code_two(refused, films, arguments, why):
    words = [str(films / a) if a in ("fast", "none") else a for a in arguments]
    refused(("propeller", "beta", *words, "-o", "out"), why)


@pytest.mark.slow
def test_an_error_says_which_film_it_is_about(tombo, films, tmp_path):
    (tmp_path / "black").mkdir()
    for k in range(10):
        cv2.imwrite(str(tmp_path / "black" / f"{k}.png"), np.zeros((100, 100), np.uint8))
    of_reference = beta(tombo, films / "fast", "--reference", tmp_path / "black", "--json")
    assert of_reference.err.startswith(f"Error: reference '{tmp_path / 'black'}': ")
    of_film = beta(tombo, tmp_path / "black", "--reference", films / "fast", "--json")
    assert of_film.err.startswith(f"Error: '{tmp_path / 'black'}': ")
    short = beta(tombo, films / "fast", *SCALE, "--window", "21", "--json")
    assert short.err.startswith(f"Error: '{films / 'fast'}': 20 frames")


def test_films_without_a_propeller_are_refused(refused, tmp_path):
    for name, level in (("black", 0), ("white", 255), ("grey", 120)):
        (tmp_path / name).mkdir()
        for k in range(10):
            picture = np.full((100, 100), level, np.uint8)
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), picture)
        refused(("propeller", "beta", name, *SCALE, "--json"), "accepted")


@pytest.mark.slow
def test_a_disc_that_leaves_the_image_is_measured_or_refused(tombo, tmp_path):
    write_folder(SyntheticVideo(replace(SCENE, off_centre=(60.0, 0.0))), 10, tmp_path / "cut")
    result = beta(tombo, tmp_path / "cut", "--scale", "1.65", "--camera-height", "6000", "--json")
    assert (
        result.code == 2 or result.json["beta"]["low_deg"] < 18 < result.json["beta"]["high_deg"]
    )


def write_trace(path, tau=0.15, level=6.0, unit="thrust_N"):
    t = np.arange(3000) * 1e-3
    folded = np.where(t < 1.0, 0.0, np.exp(-(t - 1.0) / tau))
    value = level * (1.0 - folded) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    lines = [f"time,{unit}", *(f"{a:.4f},{b:.5f}" for a, b in zip(t, value, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return tau * math.log(10.0)


def write_flat(folder):
    rows = "".join(f"{k / 1000},5.0\n" for k in range(500))
    (folder / "flat.csv").write_text("time,thrust\n" + rows)


@pytest.mark.slow
def test_a_trace_gives_its_recovery_time(tombo, tmp_path):
    truth = write_trace(tmp_path / "t.csv")
    result = tombo("propeller", "recovery", "t.csv", "-o", "out")
    assert result.code == 0, result.err
    assert "1 collision" not in result.err
    assert names(tmp_path / "out") == {"recovery.json", "recovery.csv", "recovery.png"}
    (values,) = tombo("propeller", "recovery", "t.csv", "--json").json["collisions"]
    assert values["low_s"] <= truth <= values["high_s"]
    assert values["time_s"] == pytest.approx(1.0, abs=0.003)


def test_speed_recovers_at_the_root_of_the_share(tombo, tmp_path):
    write_trace(tmp_path / "t.csv", level=4000.0, unit="rpm")
    values = tombo("propeller", "recovery", "t.csv", "--json").json
    assert values["recovered_at_share"] == pytest.approx(math.sqrt(0.9))
    (hit,) = values["collisions"]
    assert hit["recovery_s"] == pytest.approx(-0.15 * math.log(1.0 - math.sqrt(0.9)), rel=0.02)


@pytest.mark.parametrize(
    "arguments, why",
    [
        (["none.csv"], "can't read"),
        (["t.csv", "--column", "thurst_N"], "thrust_N"),
        (["t.csv", "--unit", "stone"], "unit"),
        (["t.csv", "--time-unit", "h"], "unit of time"),
        (["t.csv", "--share", "2"], "share"),
        (["t.csv", "--tare", "7"], "tare too large"),
        (["flat.csv"], "no collision"),
    ],
)
def test_bad_traces_are_refused(refused, tmp_path, arguments, why):
    write_trace(tmp_path / "t.csv")
    write_flat(tmp_path)
    refused(("propeller", "recovery", *arguments, "-o", "out"), why)


@pytest.mark.slow
def test_thrust_is_named_in_its_unit(tombo, tmp_path):
    write_trace(tmp_path / "t.csv", level=600.0, unit="thrust [gf]")
    text = tombo("propeller", "recovery", "t.csv").out
    assert "from 600 gf: recovered after 0." in text
    assert "at least" not in text
    values = tombo("propeller", "recovery", "t.csv", "--json").json
    assert (values["kind"], values["unit"], values["lower_bound"]) == ("thrust", "gf", False)
    assert values["collisions"][0]["level"] == pytest.approx(600.0, rel=0.01)


@pytest.mark.slow
def test_a_speed_trace_says_at_least(tombo, tmp_path):
    write_trace(tmp_path / "t.csv", level=4507.0, unit="rpm")
    text = tombo("propeller", "recovery", "t.csv", "-o", "out").out
    assert "from 4507 rpm: recovered after at least 0.4" in text
    assert "lower bound" in text
    values = tombo("propeller", "recovery", "t.csv", "--json").json
    assert (values["kind"], values["unit"], values["lower_bound"]) == ("speed", "rpm", True)
    (hit,) = values["collisions"]
    assert hit["level"] == pytest.approx(4507.0, rel=0.01)
    assert hit["words"].startswith("at least")
    (row,) = csv.DictReader((tmp_path / "out" / "recovery.csv").open())
    assert row["unit"] == "rpm" and row["words"].startswith("at least")


def test_a_refused_trace_is_named(tombo, tmp_path):
    write_flat(tmp_path)
    assert tombo("propeller", "recovery", "flat.csv").err.startswith("Error: 'flat.csv': no coll")
    share = tombo("propeller", "recovery", "flat.csv", "--share", "2").err
    assert share == "Error: --share 2; accepted: 0.5 to 0.99\n"
