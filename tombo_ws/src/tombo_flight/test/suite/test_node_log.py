"""Following a node's log: what is shown, how much of it, and how large the file gets."""

from __future__ import annotations

import os

from tombo_flight.suite import node_log
from tombo_flight.suite.node_log import NodeLog


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

    assert log.news(0.0) == [warning, error]
    assert log.news(1.0) == []
    assert log.last_log_lines[-1] == error


def test_half_a_line_waits_for_its_other_half(tmp_path):
    log = written(tmp_path, "[WARN] one\n[WARN] tw")
    assert log.news(0.0) == ["[WARN] one"]
    append(log, "o\n")
    assert log.news(0.1) == ["[WARN] two"]


def test_endless_warnings_are_shown_at_times_with_the_number_left_out(tmp_path):
    log = written(tmp_path, "".join(f"[WARN] {i}\n" for i in range(100)))
    assert len(log.news(0.0)) == 10
    append(log, "[WARN] again\n")
    assert log.news(0.1) == []
    append(log, "[WARN] at last\n")
    shown = log.news(2.0)
    assert shown == [f"... 91 more in {log.path}", "[WARN] at last"]


def test_a_file_that_grows_large_is_put_aside_and_begun_again(tmp_path, monkeypatch):
    monkeypatch.setattr(node_log, "_LARGEST", 1000)
    log = NodeLog(tmp_path / "node.log")
    descriptor = log.open()
    os.write(descriptor, b"x" * 999 + b"\n[WARN] first\n")
    assert log.news(0.0) == ["[WARN] first"]
    os.write(descriptor, b"[WARN] second\n")
    assert log.news(1.0) == ["[WARN] second"]
    os.close(descriptor)

    assert log.path.read_text() == "[WARN] second\n"
    assert (tmp_path / "node.log.1").stat().st_size == 1013


def test_a_log_that_somebody_removes_is_no_trouble(tmp_path):
    log = written(tmp_path, "[WARN] one\n")
    log.path.unlink()
    assert log.news(0.0) == []
