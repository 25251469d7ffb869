import base64
import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from page_reader import PageReader, blank_html, loads_nothing
from scipy.spatial.transform import Rotation

from tombo_flight.report.figures import figures_of
from tombo_flight.report.flight_report import (
    COLUMNS,
    flight_block,
    kept_samples,
    report_page,
    script_json,
)
from tombo_flight.report.page import asset, page_html, write_page

NODE = shutil.which("node")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed")


def blank_report(flight):
    """The report with a blank picture, read."""
    return PageReader(blank_html(report_page(flight)))


@pytest.fixture(scope="module")
def page(flight):
    return blank_report(flight)


def columns(block):
    raw = np.frombuffer(base64.b64decode(block["base64"]), dtype="<f4")
    table, at = {}, 0
    for name, width in block["columns"]:
        size = width * block["samples"]
        table[name] = raw[at : at + size].reshape(-1, width)
        at += size
    assert at == len(raw)
    return table


@pytest.mark.slow
def test_the_page_loads_nothing_is_small_and_always_the_same(flight):
    html = page_html(report_page(flight))
    loads_nothing(html, PageReader(html))
    for call in ("fetch(", "XMLHttpRequest", "WebSocket", "importScripts", "import("):
        assert call not in html
    assert len(html.encode()) < 3_000_000
    assert page_html(report_page(flight)) == html


def test_embedded_columns_are_the_records(flight, page):
    table = columns(page.block("flight"))
    index = np.round(table["t"][:, 0] * 1000.0).astype(int)
    for name in COLUMNS:
        wanted = flight.log[name].reshape(len(flight.t), -1)[index]
        np.testing.assert_allclose(table[name], wanted, rtol=1e-6, atol=1e-6, err_msg=name)


def run_node(path, source, *options):
    """What node prints to `source`, run from the file `path`."""
    path.write_text(source, encoding="utf-8")
    done = subprocess.run([NODE, *options, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_samples_span_the_flight(flight):
    t = flight.t[kept_samples(flight.t)]
    assert (t[0], t[-1]) == (flight.t[0], flight.t[-1])
    assert np.diff(t).max() <= 0.0111


def test_a_blow_between_samples_is_not_lost(flight):
    force = np.zeros_like(flight.log["contact_force"])
    force[30_013, 1] = -77.0
    record = replace(flight, log={**flight.log, "contact_force": force})
    blow = columns(flight_block(record))["contact_N"]
    assert blow.max() == pytest.approx(77.0)
    assert np.count_nonzero(blow) == 1


def test_text_from_outside_stays_text(flight):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>{{plot}}&amp;"
    record = replace(
        flight,
        events=[*flight.events, {"time_s": 24.0, "kind": 'x" onclick="y', "text": evil}],
        summary={**flight.summary, "scenario": evil},
    )
    page = blank_report(record)
    tags = [tag for tag, _ in page.elements]
    assert tags.count("script") == 3
    assert tags.count("img") == 1  # the figure
    assert not any(key.startswith("on") for _, a in page.elements for key in a)
    assert evil in page.text_in("title")
    assert evil in page.text
    assert page.block("milestones")["events"][-1]["text"] == evil


@pytest.mark.parametrize(
    "other", [{"name": "mine"}, {"name": "paper_collision", "mission": {"course": [{"x": 1.0}]}}]
)
def test_a_flight_of_ones_own_is_not_held_against_the_paper(flight, other):
    own = replace(flight, scenario={**flight.scenario, **other})

    assert all(printed is None for _, _, printed in figures_of(own))
    page = blank_report(own)
    assert "Paper" not in page.texts[("th", None)]
    assert not [text for text in page.words if text.startswith("paper ")]


def test_the_table_holds_the_papers_figures_against_the_flights(flight):
    rows = {figure.key: (value, printed) for figure, value, printed in figures_of(flight)}
    unstable_s, recovery_s = (
        flight.summary[f"{n}_s"] for n in ("unstable_phase", "recovery_time")
    )
    assert rows["unstable_phase_s"] == (unstable_s, 1.5)
    assert rows["recovery_phase_s"] == (pytest.approx(recovery_s - unstable_s), 3.5)
    assert rows["recovery_time_s"] == (recovery_s, 5.0)
    assert rows["max_falling_distance_m"] == (flight.summary["max_falling_distance_m"], 0.5)
    assert rows["contact_known_s"] == (
        pytest.approx(1e3 * flight.summary["contact_known_s"]),
        None,
    )
    assert rows["bounce_m"] == (pytest.approx(0.8, abs=1e-4), 0.8)


def test_json_for_scripts_has_no_markup_and_no_nan():
    value = {"a": float("nan"), "b": np.float64(2.0), "c": "</script>&\u2028", "d": np.arange(2)}
    text = script_json(value)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == {"a": None, "b": 2.0, "c": "</script>&\u2028", "d": [0, 1]}


@needs_node
def test_the_pages_own_code_reads_the_flight(flight, page, tmp_path):
    times = [0.0, 5.013, 22.9, 23.5, 27.3, 30.0001, float(flight.t[-1])]
    probe = """
const flight = decodeFlight(block);
const out = times.map((t) => ({
  position: rowAt(flight, "position", t),
  mode: heldAt(flight, "mode", t)[0],
  up: turner(attitudeAt(flight, t))([0, 0, 1]),
  tilt: tiltOf(attitudeAt(flight, t)),
  angles: rollPitchYaw(attitudeAt(flight, t)),
}));
console.log(JSON.stringify(out));
"""
    head = f"const block = {json.dumps(page.block('flight'))}, times = {times};"
    found = json.loads(run_node(tmp_path / "probe.js", asset("flight.js") + head + probe))
    for t, seen in zip(times, found, strict=True):
        true = [np.interp(t, flight.t, flight.log["position"][:, k]) for k in range(3)]
        assert seen["position"] == pytest.approx(true, abs=2e-3), t
        i = int(np.searchsorted(flight.t, t + 1e-9)) - 1
        attitude = Rotation.from_quat(flight.log["attitude"][i])
        up = attitude.apply([0.0, 0.0, 1.0])
        assert seen["up"] == pytest.approx(up, abs=0.02), t
        assert seen["tilt"] == pytest.approx(np.degrees(np.arccos(up[2])), abs=1.5)
        roll_deg = attitude.as_euler("xyz", degrees=True)[0]
        assert seen["angles"][0] == pytest.approx(roll_deg, abs=1.5)
    assert [seen["mode"] for seen in found][3:5] == [4.0, 4.0]


@needs_node
@pytest.mark.parametrize("rotor", [0, 2])
def test_a_wing_folds_backwards_in_the_plane_of_the_disc(rotor, tmp_path):
    shape = {"rotors_m": [[0, 0, 0.03]] * 4, "disc_m": 0.111, "nodus_m": 0.035, "leg_m": 0.2}
    rows = {
        "position": [0, 0, 0],
        "attitude": [0, 0, 0, 1],
        "fold": [0.4 * (k == rotor) for k in range(4)],
        "damage": [0] * 4,
        "rotor_speed": [500] * 4,
        "rotor_thrust": [0] * 4,
    }
    probe = f"""
const rows = {json.dumps(rows)};
rowAt = (flight, name) => rows[name];
attitudeAt = () => rows.attitude;
const parts = vehicleParts({{}}, {json.dumps(shape)}, 0, [0, 0, 9]);
const blades = parts.filter((p) => p.kind === "blade");
console.log(JSON.stringify(blades.map((p) => [p.rotor, p.points])));
"""
    scripts = asset("flight.js") + asset("vehicle.js")
    blades = json.loads(run_node(tmp_path / "probe.js", scripts + probe))
    assert np.allclose([[z for _, _, z in points] for _, points in blades], 0.03)
    (_, nodus, tip), *_ = (np.array(points) for r, points in blades if r == rotor)
    assert np.hypot(*tip[:2]) == pytest.approx(0.035 + 0.6 * 0.076)  # the reach of docs/model.md
    spin = 1 if rotor < 2 else -1
    assert spin * np.cross(nodus, tip - nodus)[2] < 0


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
@pytest.mark.parametrize("name", ["whole", "no contact", "one sample"])
def test_a_browser_runs_the_page_without_a_complaint(flight, edge_flights, name, tmp_path):
    path = tmp_path / "report.html"
    write_page(path, report_page(flight if name == "whole" else edge_flights[name]))
    options = [
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}", "--enable-logging=stderr",
        "--virtual-time-budget=2000", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    try:
        done = subprocess.run([BROWSER, *options], capture_output=True, text=True, timeout=60)
    except subprocess.TimeoutExpired:
        pytest.skip("the browser does not end on this machine")
    logged = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    complaints = [line for line in logged if "source: chrome://" not in line]  # the browser's own
    assert not complaints
    assert 'data-ready="yes"' in done.stdout
