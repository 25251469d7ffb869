import io
import shutil
import threading
import zipfile

import pytest

pytest.importorskip("starlette", reason="`make workbench` was not run")
pytest.importorskip("httpx", reason="`make workbench` was not run")
import uvicorn
from starlette.testclient import TestClient

from tombo_dynamics.propeller import read_library
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario
from tombo_web.server import Access, bound_socket
from tombo_web.workbench import Workbench
from tombo_web.workbench_page import workbench_page
from tombo_web.workbench_server import WorkbenchServer

LIBRARY = read_library()
CHROMIUM = shutil.which("chromium")
READY = "html[data-state=ready]"


def client_of(host="127.0.0.1"):
    server = WorkbenchServer(Workbench(LIBRARY), Access(host, 8361, "secret"), "<p>page</p>")
    return TestClient(server.app, base_url=f"http://{host}:8361")


def test_curves_come_as_json_and_a_knob_moves_them():
    client = client_of()
    plain = client.post("/ask/curves", json={}).json()
    stiff = client.post("/ask/curves", json={"propeller": {"fibres": 9}}).json()
    assert plain["label"] != stiff["label"]
    assert plain["panels"][0]["curves"] != stiff["panels"][0]["curves"]


@pytest.mark.parametrize(
    ("host", "headers", "query", "status"),
    [
        ("127.0.0.1", {}, "", 200),
        ("127.0.0.1", {"host": "evil.example:8361"}, "", 403),
        ("127.0.0.1", {"origin": "http://evil.example"}, "", 403),
        ("10.0.0.7", {}, "", 403),
        ("10.0.0.7", {}, "?token=secret", 200),
    ],
)
def test_who_may_ask(host, headers, query, status):
    client = client_of(host)
    assert client.post(f"/ask/curves{query}", json={}, headers=headers).status_code == status
    assert client.get(f"/{query}", headers=headers).status_code == status


@pytest.mark.parametrize(
    ("what", "body", "message"),
    [
        ("curves", b"", "no JSON object"),
        ("curves", b'{"a": "' + b"x" * 200_000, "too large"),
        ("curves", b'{"propeller": 3}', "propeller"),
        ("curves", b'{"propeller": {"blade": "table"}}', "blade"),
        ("no", b"{}", "request"),
    ],
)
def test_a_bad_request_is_refused_with_what_is_accepted(what, body, message):
    answer = client_of().post(f"/ask/{what}", content=body)
    refused = answer.json()["error"]
    assert message in refused and ("accepted" in refused or "is not a number from" in refused)


@pytest.fixture(scope="module")
def address():
    """Serve a workbench in this process, as `tombo workbench` does."""
    listener = bound_socket("127.0.0.1", 0)
    access = Access("127.0.0.1", listener.getsockname()[1], "secret")
    app = WorkbenchServer(Workbench(LIBRARY), access, workbench_page(LIBRARY)).app
    server = uvicorn.Server(uvicorn.Config(app, log_level="warning"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    yield access.url
    server.should_exit = True
    thread.join()
    listener.close()


@pytest.fixture
def page(address, request):
    """Return the open page in a browser without a network, and what its console said."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on this system")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        shown = browser.new_page(viewport={"width": request.param, "height": 900})
        shown.said = []
        shown.on("console", lambda message: shown.said.append(message.text))
        shown.on("pageerror", lambda error: shown.said.append(str(error)))
        shown.goto(address)
        shown.wait_for_selector(READY, timeout=60_000)
        yield shown
        browser.close()


@pytest.mark.slow
@pytest.mark.parametrize("page", [1280, 390], indirect=True)
def test_the_page_by_keyboard_alone(page):
    before = page.text_content("#label")
    page.focus("#length_mm")
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector("#label:text-matches('11.9 mm long')")
    assert page.text_content("#label") != before
    assert page.locator("#panels canvas").count() == 7
    wide, seen = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide <= seen and page.said == []


@pytest.mark.slow
@pytest.mark.parametrize("page", [1280, 390], indirect=True)
def test_a_vehicle_is_recommended_a_nodus_and_flown(page):
    page.fill("#min_thrust_margin", "1.7")
    page.fill("#max_collision_force_N", "150")
    page.click("#recommend")
    page.wait_for_selector("#answer tr.best", timeout=120_000)
    assert page.locator("#answer .fronts canvas").count() == 4
    assert page.locator("#answer tr.best small").count() > 1
    wide, seen = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert wide <= seen
    page.locator("#answer tr.best button", has_text="Fly it").click()
    page.wait_for_selector("#answer h2:text-matches('struck with')", timeout=120_000)
    with page.context.expect_page() as opened:
        page.click("#answer a")
    opened.value.wait_for_selector("#scene")
    assert page.said == []


def test_a_recommended_nodus_comes_with_the_knobs_that_make_it():
    answer = client_of().post("/ask/design", json={"vehicle": {"mass_kg": 1.2}}).json()
    best = answer["candidates"][0]
    made = {k: best[k] for k in ("matrix", "fibre", "fibres", "fibre_diameter_mm", "length_mm")}
    curves = client_of().post("/ask/curves", json={"propeller": made}).json()
    assert curves["label"].endswith(best["nodus"])
    assert best["figures"]["thrust_margin"]["value"] >= 2.0


def test_results_are_seen_by_whom_the_page_is_seen(monkeypatch):
    assert client_of().get("/page/1").status_code == 404
    monkeypatch.setattr(Workbench, "page", lambda bench, number: "<p>flight</p>")
    assert client_of("10.0.0.7").get("/page/1").status_code == 403
    assert client_of("10.0.0.7").get("/page/1?token=secret").text == "<p>flight</p>"


@pytest.mark.slow
def test_the_exported_library_flies_as_the_workbench_flew_it(tmp_path):
    client = client_of()
    asked = {"propeller": {"fibres": 8}, "vehicle": {"mass_kg": 1.2}, "seed": 3}
    flown = client.post("/ask/fly", json=asked).json()
    assert flown["collided"] and client.get(f"/page/{flown['page']}").status_code == 200
    with zipfile.ZipFile(io.BytesIO(client.post("/ask/library", json=asked).content)) as archive:
        archive.extractall(tmp_path)
    again = fly_scenario(load_scenario(str(tmp_path / "propeller" / "design.yaml")), 3)
    for name in ("recovery_time_s", "max_falling_distance_m", "crashed"):
        assert again.summary[name] == flown[name]
