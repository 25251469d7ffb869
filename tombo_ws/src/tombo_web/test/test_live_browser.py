"""The live page in Chromium: `pip install playwright`, and Chromium of the distribution."""

import shutil
import threading
import time

import pytest

pytest.importorskip("playwright", reason="playwright is not installed")
pytest.importorskip("uvicorn", reason="`make live` was not run")
import uvicorn
from playwright.sync_api import sync_playwright
from test_live_session import session_of

from tombo_web.live_page import live_page
from tombo_web.server import Access, LiveServer, bound_socket

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)
OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
           "--disable-background-networking", "--disable-component-update")  # fmt: skip

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed"),
]


def wait(page, expression, timeout_s=20.0):
    """Wait until an expression of the page holds; its policy forbids Playwright's own way."""
    end = time.monotonic() + timeout_s
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"never: {expression}"
        page.wait_for_timeout(30)


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(OPTIONS))
        yield opened
        opened.close()


@pytest.fixture
def served():
    """A flight that is played back, and the address of its page."""
    listener = bound_socket("127.0.0.1", 0)
    access = Access("127.0.0.1", listener.getsockname()[1], "secret")
    session = session_of()
    app = LiveServer(session, access, live_page("climb", {})).app
    config = uvicorn.Config(app, log_level="error", ws="websockets-sansio")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    yield session, access.url
    server.should_exit = True
    thread.join()


@pytest.fixture(params=[1280, 390])
def page(request, browser, served):
    session, url = served
    opened = browser.new_page(viewport={"width": request.param, "height": 850})
    complaints, asked = [], []
    opened.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("request", lambda r: asked.append(r.url))
    opened.goto(url)
    wait(opened, "Boolean(window.live && live.last && live.last.t > 0.3)")
    yield opened, session
    assert complaints == []
    assert {u.split("/")[2] for u in asked if u.startswith("http")} == {url.split("/")[2]}
    opened.close()


def test_the_keyboard_alone_pauses_steps_and_seeks(page):
    opened, session = page
    opened.keyboard.press("Space")
    wait(opened, "live.paused")
    before = session.source.now_s
    opened.keyboard.press(".")
    wait(opened, f"live.now > {before} + 0.005")
    assert session.source.now_s == pytest.approx(before + 0.01)
    opened.keyboard.press("ArrowRight")
    wait(opened, f"live.now > {before} + 0.9")


def test_a_curve_is_picked_by_name_and_drawn(page):
    opened, _ = page
    opened.fill("#pick", "/mocap/pose.position.x")
    opened.keyboard.press("Enter")
    opened.wait_for_selector("[data-name='/mocap/pose.position.x'] canvas")
    opened.fill("#pick", "/no/such")
    opened.keyboard.press("Enter")
    wait(opened, "document.getElementById('refused').textContent.includes('no such')")


def test_states_are_shown_and_nothing_is_wider_than_the_page(page):
    opened, _ = page
    wait(opened, "document.getElementById('states').innerText.includes('takeoff')")
    assert opened.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert opened.evaluate("location.search") == ""  # the token is not left in the address
    assert opened.is_hidden("#operator")
