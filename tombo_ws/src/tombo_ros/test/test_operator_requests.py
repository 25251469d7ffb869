"""Every key of the operator reaches the node with the last word, whichever other node is dead."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.task import Future

from tombo_ros import operator_requests
from tombo_ros.operator_requests import OperatorRequests

DEAD = ("none", "mission", "reaction", "detector", "estimator", "recorder", "sim")
"""Nodes but the one with the last word before the rotors."""
LAST_WORD = {False: "controller", True: "px4"}
DOES = {
    "controller/abort": "land",
    "controller/kill": "kill",
    "px4/land": "land",
    "px4/hold": "hold",
    "px4/kill": "kill",
    "mission/hold": "hold",
}
"""Service → what the vehicle does, once its node obeys."""


class Nodes:
    """The graph: dead nodes, silent nodes, and calls."""

    def __init__(
        self, *, px4: bool, dead: str = "", silent: str = "", refuses: tuple[str, ...] = ()
    ):
        self._px4, self.dead, self.silent, self.refuses = px4, dead, silent, refuses
        self.called: list[str] = []

    def count_publishers(self, topic: str) -> int:
        assert topic == "/px4/status"
        return int(self._px4)

    def create_client(self, kind: object, name: str) -> SimpleNamespace:
        node = name.split("/")[0]
        there = node != self.dead and (node != LAST_WORD[not self._px4])
        return SimpleNamespace(
            service_is_ready=lambda: there,
            wait_for_service=lambda timeout_sec: there,
            call_async=lambda request: self._call(name, node),
        )

    def _call(self, name: str, node: str) -> Future:
        future: Future = Future()
        if node != self.silent:
            obeys = name not in self.refuses
            if obeys:
                self.called.append(name)
            future.set_result(SimpleNamespace(success=obeys, message="" if obeys else "not now"))
        return future


@pytest.fixture(autouse=True)
def _no_ros(monkeypatch):
    monkeypatch.setattr(operator_requests.rclpy, "spin_once", lambda node, timeout_sec: None)


def request(nodes: Nodes, name: str, monkeypatch: pytest.MonkeyPatch) -> dict:
    """The answer to a key, however long it takes."""
    requests = OperatorRequests(nodes)
    answers = requests.read(f"{name}\n")
    for later_s in (0.0, 10.0, 20.0):
        now_s = operator_requests.time.monotonic() + later_s
        with monkeypatch.context() as patched:
            patched.setattr(operator_requests.time, "monotonic", lambda now_s=now_s: now_s)
            answers += requests.answers()
    assert len(answers) == 1
    return answers[0]["answer"]


@pytest.mark.parametrize("px4", [False, True], ids=["controller", "px4"])
@pytest.mark.parametrize("how", ["dead", "silent"])
@pytest.mark.parametrize("node", DEAD)
@pytest.mark.parametrize("key", ["hold", "land", "kill"])
def test_every_key_works_with_every_other_node_dead(key, node, how, px4, monkeypatch):
    nodes = Nodes(px4=px4, **{how: node})
    answer = request(nodes, key, monkeypatch)

    done = [DOES[name] for name in nodes.called if name in DOES]
    # without the mission nobody holds a vehicle of our controller: it lands
    wanted = "land" if key == "hold" and node == "mission" and not px4 else key
    assert done == [wanted], nodes.called
    assert answer["request"] == key and answer["success"], answer
    if key == "kill":
        assert nodes.called == [f"{LAST_WORD[px4]}/kill"]


def test_what_nobody_obeys_is_refused_with_the_reasons(monkeypatch):
    nodes = Nodes(px4=True, dead="mission", refuses=("px4/hold", "px4/land"))
    answer = request(nodes, "hold", monkeypatch)
    assert not answer["success"]
    assert answer["message"] == (
        "px4/hold: not now; land instead; no node offers mission/land; px4/land: not now"
    )
    assert not request(Nodes(px4=False, silent="controller"), "kill", monkeypatch)["success"]


def test_on_the_ground_land_takes_the_take_off_back(monkeypatch):
    for px4, first in ((True, "px4/land"), (False, "controller/abort")):
        nodes = Nodes(px4=px4, refuses=(first,))
        answer = request(nodes, "land", monkeypatch)
        assert answer["success"] and nodes.called == ["mission/land"]
        assert f"{first}: not now" in answer["message"]
