"""Progress without a terminal: a line now and then, none of a short command."""

from tombo_bringup.cli import progress


def test_a_line_every_ten_seconds_through_a_pipe(monkeypatch, capsys):
    now = 0.0
    monkeypatch.setattr(progress, "_LINE_S", 10.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    with progress.progress_bar() as on_progress:
        for second in range(35):
            now = float(second)
            on_progress("flying", second / 100)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["flying, 10%", "flying, 20%", "flying, 30%"]
