"""Hold, land and kill, pressed on the live page while the nodes fly."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import closing, contextmanager, suppress

import numpy as np
import pytest
from parameter_calls import call_trigger

from in_time import NotInTime, in_time
from ros_bench import Counterpart, die_with_the_test, ros_domain
from tombo_bag.topics import DIAGNOSTICS, MISSION_STATUS, ROTOR_COMMAND, TRUE_ODOMETRY
from tombo_dynamics.messages import Phase
from tombo_ros.conversion import array

pytestmark = pytest.mark.real_time

pytest.importorskip("rclpy")
pytest.importorskip("uvicorn", reason="`make live` was not run")
client = pytest.importorskip("websockets.sync.client", reason="`make live` was not run")
CHROMIUM = shutil.which("chromium")
PATIENCE_S = 90.0
CLIMB_M_S = 0.2
SETTINGS = ("mission.land_time=3000", "mission.height=6", f"mission.climb_speed={CLIMB_M_S}")
"""It climbs while the page is used, so that to hold is to stop."""
SLOW = ("--speed", "0.4")
"""A busy machine flies too."""


@contextmanager
def tombo(folder, *arguments):
    """Run a command of the product; yield its process and the file of its output."""
    path = folder / f"{arguments[0]}.log"
    with path.open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "tombo_bringup.cli.main", *arguments],
            stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            start_new_session=True, preexec_fn=die_with_the_test,
        )  # fmt: skip
    try:
        yield process, path
    finally:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(30.0)
        process.kill()
        process.wait()


def address_of(live, log):
    """Wait for the address that `tombo live` prints."""
    end = time.monotonic() + PATIENCE_S
    while not (match := re.search(r"live: (http://\S+)", log.read_text())):
        assert live.poll() is None and time.monotonic() < end, log.read_text()
        time.sleep(0.05)
    return match[1]


class Client:
    """Requests of clients, with and without an origin."""

    def __init__(self, url, origin):
        self._url, self._origin = url.replace("http", "ws").replace("/?", "/stream?"), origin

    def ask(self, name):
        """Return the answer to a request."""
        with client.connect(self._url, origin=self._origin, max_size=None) as stream:
            stream.send(json.dumps({"do": name}))
            while (answer := json.loads(stream.recv(PATIENCE_S)))["kind"] in ("hello", "frame"):
                pass
        return answer


class Page:
    """The page in a browser, used by keyboard."""

    def __init__(self, browser, url):
        self._page = browser.new_page(viewport={"width": 400, "height": 300})
        self._page.set_default_timeout(1e3 * PATIENCE_S)
        self._page.goto(url)
        self._page.wait_for_selector("#operator:not([hidden])")

    def press(self, name, passing=("sent",)):
        """Press a button; return the answer that is shown, but for passing ones."""
        self._page.evaluate("document.getElementById('answer').textContent = ''")
        self._page.focus(f"[data-ask={name}]")
        self._page.keyboard.press("Enter")
        end = time.monotonic() + PATIENCE_S
        while not (text := self._page.text_content("#answer")) or text.endswith(passing):
            assert time.monotonic() < end, f"no answer to {name}: {text}"
            self._page.wait_for_timeout(20)
        return text

    def press_until_obeyed(self, name):
        """Press again while the page has not met the node yet, or the first press is too old."""
        end = time.monotonic() + PATIENCE_S
        while re.search("no node offers|press again|no answer", answer := self.press(name)):
            assert time.monotonic() < end, answer


@pytest.fixture
def page_of():
    """Open addresses in a browser."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield lambda url: Page(browser, url)
        browser.close()


class Watch:
    """The vehicle's state, received without the page."""

    def __init__(self, world):
        self.world = world
        world.subscribe(DIAGNOSTICS, MISSION_STATUS, TRUE_ODOMETRY, ROTOR_COMMAND)

    def phase(self, phase):
        self.world.wait_for(MISSION_STATUS, lambda m: m.phase == phase, patience_s=PATIENCE_S)

    def takes_off(self):
        """Wait until it is high enough to fall; where a late machine lands it, ask again."""
        end = time.monotonic() + 2.0 * PATIENCE_S
        while True:
            obeyed, why = call_trigger(self.world, "mission", "takeoff")
            assert obeyed or "it flies" in why, why
            try:
                return self.world.wait_for(
                    TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 0.8, patience_s=30.0
                )
            except NotInTime:
                if time.monotonic() > end:
                    raise

    def positions(self, seconds):
        """Return the poses of a span of the flight (n, 3)."""
        self.world.hear()
        first, since = None, len(self.world.heard[TRUE_ODOMETRY.name])

        def late(message):
            nonlocal first
            now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            first = now if first is None else first
            return now > first + seconds

        self.world.wait_for(TRUE_ODOMETRY, late, since=since)
        return np.array(
            [array(m.pose.pose.position) for m in self.world.heard[TRUE_ODOMETRY.name][since:]]
        )

    def rotors_off(self):
        self.world.wait_for(ROTOR_COMMAND, lambda m: max(m.speed) == 0.0, patience_s=PATIENCE_S)


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    """The suite on the ground, its live page's address, and what hears the vehicle."""
    folder = tmp_path_factory.mktemp("suite")
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    with (
        ros_domain(),
        closing(Counterpart()) as world,
        tombo(folder, "up", "hover", *SLOW, *settings, "-o", str(folder / "up"), "--json"),
        tombo(folder, "live", "--port", "0") as (live, log),
    ):
        yield address_of(live, log), Watch(world)


@pytest.fixture
def flying(suite):
    """The suite in a slow climb."""
    suite[1].takes_off()
    return suite


def test_only_the_page_with_its_token_is_obeyed(flying):
    url, watch = flying
    page, _, token = url.partition("/?token=")
    strangers = {
        "another page": Client(url, "http://evil.example"),
        "no page": Client(url, None),
        "another token": Client(url.replace(token, "x" * len(token)), page),
    }
    for name, stranger in strangers.items():
        assert stranger.ask("land")["kind"] == "refused", name
    since = len(watch.world.heard[MISSION_STATUS.name])
    watch.positions(1.0)
    phases = {m.phase for m in watch.world.heard[MISSION_STATUS.name][since:]}
    assert not phases & {Phase.LAND, Phase.LANDED}  # told at each change

    assert Client(url, page).ask("land")["kind"] == "answer"
    watch.phase(Phase.LANDED)
    watch.rotors_off()


def test_the_vehicle_holds_lands_and_is_killed_by_the_second_press(page_of, flying):
    url, watch = flying
    page = page_of(url)
    page.press_until_obeyed("hold")
    watch.world.wait_for_fault("mission", "operator", "held by an operator")
    held = watch.positions(4.0)
    with in_time():
        assert np.ptp(held, axis=0).max() < 0.5 * 4.0 * CLIMB_M_S and held[:, 2].min() > 0.5

    page.press_until_obeyed("land")
    watch.phase(Phase.LANDED)
    watch.rotors_off()
    assert watch.positions(0.1)[-1, 2] < 0.3

    watch.takes_off()
    assert "press again" in page.press("kill")
    flown = watch.positions(3.0)  # longer than the first press counts
    assert max(watch.world.heard[ROTOR_COMMAND.name][-1].speed) > 0.0
    with in_time():
        assert flown[:, 2].min() > 0.5
    page.press_until_obeyed("kill")
    watch.rotors_off()
    assert watch.positions(1.0)[-1, 2] < 0.5
