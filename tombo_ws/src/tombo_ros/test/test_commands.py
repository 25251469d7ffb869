"""A command of an operator is obeyed, or refused and then not obeyed later."""

from __future__ import annotations

import threading
from collections import deque
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from tombo_ros import core_node
from tombo_ros.core_node import LOOP_SILENT, CoreNode


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Needs of a service from its node; nobody runs the loop."""
    monkeypatch.setattr(core_node, "_ANSWER_S", 0.05)
    return SimpleNamespace(_commands=deque())


def test_a_command_that_the_loop_has_not_taken_is_withdrawn(node: Any) -> None:
    answer = CoreNode._command_service(node, "land")(None, SimpleNamespace())
    assert (answer.success, answer.message) == (False, LOOP_SILENT)
    [(_, refusal)] = node._commands
    assert not refusal.set_running_or_notify_cancel()


def test_a_command_that_the_loop_has_taken_late_is_answered_by_the_loop(node: Any) -> None:
    class Taken(deque[Any]):
        """The loop takes the command, and answers after it would have been withdrawn."""

        def append(self, command: Any) -> None:
            _, refusal = command
            refusal.set_running_or_notify_cancel()
            threading.Timer(0.1, refusal.set_result, ["it stands on the ground"]).start()

    node._commands = Taken()
    answer = CoreNode._command_service(node, "land")(None, SimpleNamespace())
    assert (answer.success, answer.message) == (False, "it stands on the ground")
