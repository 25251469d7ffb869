"""Faults on `/diagnostics`: when they are logged, and their text in a report."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from tombo_dynamics.time_base import SECOND_NS
from tombo_ros import health as module
from tombo_ros.health import ERROR, WARN, Health


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Collect the reports in place of publishing them."""
    reports: list[Any] = []
    output = SimpleNamespace(publish=reports.append)
    monkeypatch.setattr(module, "TopicPublisher", lambda node, spec: output)
    return reports


@pytest.fixture
def health(sent: list[Any]) -> Health:
    logger = logging.getLogger("node")
    return Health(SimpleNamespace(get_name=lambda: "node", get_logger=lambda: logger))


def _status(health: Health, sent: list[Any]) -> Any:
    health.send(0, {})
    return sent[-1].status[0]


def test_a_report_has_the_newest_reason_of_an_active_fault(health, sent):
    health.report_event("setpoint_refused", "NaN")
    assert _status(health, sent).message == "setpoint_refused: NaN"
    health.report_event("setpoint_refused", "of another simulation", ERROR)
    status = _status(health, sent)
    assert status.message == "setpoint_refused: of another simulation"
    assert status.level == bytes([ERROR])
    assert {v.key: v.value for v in status.values} == {"fault.setpoint_refused": "active, 1 times"}


def test_a_fault_is_logged_and_urgent_when_it_comes_and_goes(health, sent, caplog):
    caplog.set_level(logging.INFO)
    for age_s in (0.3, 0.4, 0.5):
        health.fault("silent", True, f"the last pose is {age_s} s old", WARN)
    assert health.urgent
    assert _status(health, sent).message == "silent: the last pose is 0.5 s old"
    assert not health.urgent
    health.fault("silent", True, "the last pose is 0.6 s old")
    assert not health.urgent
    health.fault("silent", False, "the last pose is 0.0 s old")
    assert health.urgent
    assert _status(health, sent).message == "ok"
    assert [r.message for r in caplog.records] == [
        "silent: the last pose is 0.3 s old",
        "silent: over",
    ]


def test_an_event_is_in_the_reports_of_each_second(health, sent, monkeypatch):
    monkeypatch.setattr(module.time, "time_ns", lambda: 0)
    health.report_event("refused", "NaN")
    health.clear_expired(SECOND_NS + 100_000_000)  # a report that comes late
    assert _status(health, sent).message == "refused: NaN"
    health.clear_expired(2 * SECOND_NS)
    assert _status(health, sent).message == "ok"
