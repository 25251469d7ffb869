"""A page that shows one of some flights: its scripts, run without a browser."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from tombo_flight.report.flight_report import replay_scripts
from tombo_flight.report.html import asset

NODE = shutil.which("node")
WINDOW = """
const fs = require("fs"), vm = require("vm");
const html = fs.readFileSync(process.argv[2], "utf8"), frames = [], cache = {};
const blocks = Object.fromEntries([...html.matchAll(
  /<script id="([^"]+)" type="application\\/json">([^]*?)<\\/script>/g)].map((m) => [m[1], m[2]]));
const ids = new Set([...html.matchAll(/ id="([^"]+)"/g)].map((m) => m[1]));
const pen = new Proxy({}, { get: () => () => ({ width: 9, addColorStop() {} }), set: () => true });
const known = { cloneNode: () => element(), getContext: () => pen, [Symbol.toPrimitive]: () => "",
  getBoundingClientRect: () => ({ left: 0, top: 0, width: 400, height: 300 }),
  querySelectorAll: () => Array.from({ length: 12 }, element) };
function element() {
  const own = { dataset: {}, style: {}, children: [], clientWidth: 400, clientHeight: 300 };
  own.addEventListener = (name, act) => { own["on" + name] = act; };
  own.setAttribute = (name, value) => { own[name] = value; };
  return new Proxy(own, { get: (t, k) => t[k] ?? known[k] ?? element });
}
const buttons = [0, 1].map((n) => Object.assign(element(), { dataset: { flight: String(n) } }));
const document = { body: element(), documentElement: element(), addEventListener() {},
  createElement: element, querySelector: element,
  querySelectorAll: (what) => (what === "[data-flight]" ? buttons : []),
  getElementById(id) {
    if (id in blocks) return { textContent: blocks[id] };
    if (!ids.has(id)) throw new Error("no element " + id);
    return (cache[id] ??= element());
  } };
const context = vm.createContext({ document, window: { matchMedia: element }, Path2D: element,
  ResizeObserver: class { observe() {} disconnect() {} },
  requestAnimationFrame: (draw) => frames.push(draw),
  getComputedStyle: () => ({ getPropertyValue: () => "1 2 3" }),
  atob: (text) => Buffer.from(text, "base64").toString("latin1") });
vm.runInContext(html.match(/<script>\\n([^]*?)<\\/script>/)[1], context);
const seen = () => {
  frames.splice(0).forEach((draw) => draw(100));
  return [vm.runInContext("player.flight.count", context), cache["clock-time"].textContent,
    buttons.map((b) => b["aria-pressed"])];
};
const found = [seen()], first = vm.runInContext("player", context);
buttons[1].onclick();
first.seek(1.0);  // the player before has left the page
found.push(seen());
buttons[0].onclick();
found.push(seen());
console.log(JSON.stringify(found));
"""


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_flight_that_is_asked_for_is_shown_and_the_one_before_has_left(make_flight, tmp_path):
    records = [make_flight(), make_flight(crash=True, end_s=30.0)]
    page, probe = tmp_path / "page.html", tmp_path / "probe.js"
    page.write_text(asset("stage.html") + replay_scripts(records), encoding="utf-8")
    probe.write_text(WINDOW, encoding="utf-8")
    done = subprocess.run([NODE, probe, page], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    first, second, again = json.loads(done.stdout)
    assert first == again
    assert second[0] < first[0]  # a shorter flight has fewer samples
    assert first[1] == second[1] == "23.15 s"  # just after the contact
    assert (first[2], second[2]) == (["true", "false"], ["false", "true"])
