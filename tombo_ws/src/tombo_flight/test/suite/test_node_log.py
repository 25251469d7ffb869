"""Following a node's log: the lines shown, and their number."""

from __future__ import annotations

import os

from tombo_flight.suite.supervisor import NodeLog


def written(tmp_path, text: str) -> NodeLog:
    log = NodeLog(tmp_path / "node.log")
    os.close(log.open())
    append(log, text)
    return log


def append(log: NodeLog, text: str) -> None:
    with log.path.open("a") as file:
        file.write(text)


def test_warnings_and_errors_are_news_and_nothing_else(tmp_path):
    warning, error = "[WARN] [1.5] [sim]: late", "[ERROR] [1.6] [sim]: silent"
    log = written(tmp_path, f"[INFO] [1.0] [sim]: running\n{warning}\nan ERROR?\n{error}\n")

    assert log.news() == [warning, error]
    assert log.news() == []
    assert log.last_log_lines[-1] == error


def test_half_a_line_waits_for_its_other_half(tmp_path):
    log = written(tmp_path, "[WARN] one\n[WARN] tw")
    assert log.news() == ["[WARN] one"]
    append(log, "o\n")
    assert log.news() == ["[WARN] two"]


def test_of_many_warnings_the_first_are_shown_and_the_number_left_out(tmp_path):
    log = written(tmp_path, "".join(f"[WARN] {i}\n" for i in range(100)))
    assert log.news() == [*(f"[WARN] {i}" for i in range(10)), f"... 90 more in {log.path}"]
    append(log, "[WARN] again\n")
    assert log.news() == ["[WARN] again"]
